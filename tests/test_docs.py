"""The documentation agrees with the code: examples run, and names, links and tables are right."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import msgspec
import pytest
import typer
import yaml

from gimpmd_deploy.cli.app import app
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import FACES, Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.wire.fields import ENERGY_FIELDS, TOTAL_FIELDS
from tests.services.coupler.conftest import start  # noqa: F401

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/*.md", "schemas/*.md", "services/*/*.md", "examples/*/*.md")
    for page in ROOT.glob(pattern)
)
CASE_MD = (ROOT / "docs/case.md").read_text(encoding="utf-8")
REQUIRED = msgspec.NODEFAULT


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


each_page = pytest.mark.parametrize("page", PAGES, ids=name_of)


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a language in a page."""
    text = page.read_text("utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def each_block(language: str) -> pytest.MarkDecorator:
    """Parametrize a test by the blocks of a language in all pages."""
    found = [
        pytest.param(page, block, id=f"{name_of(page)}-{index}")
        for page in PAGES
        for index, block in enumerate(blocks(page, language))
    ]
    return pytest.mark.parametrize(("page", "block"), found)


# --- the case file -----------------------------------------------------------------


def keys(struct: type[msgspec.Struct], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Keys as ``case.md`` writes them, with their defaults as plain values."""
    tag = struct.__struct_config__.tag_field
    if tag:
        yield prefix + tag, REQUIRED
    for field in msgspec.structs.fields(struct):
        annotation: Any = field.type
        name = "*" if field.encode_name in FACES else field.encode_name
        is_list = get_origin(annotation) is tuple
        inner = [
            option
            for option in (annotation, *get_args(annotation))
            if isinstance(option, type) and issubclass(option, msgspec.Struct)
        ]
        default = field.default
        if default is REQUIRED and field.default_factory is not REQUIRED:
            default = field.default_factory()
        if is_list or len(inner) != 1:
            yield (
                prefix + name,
                msgspec.to_builtins(default) if default is not REQUIRED else default,
            )
        for option in inner:
            yield from keys(option, f"{prefix}{name}{'[]' if is_list else ''}.")


def documented() -> dict[str, str]:
    """Keys in the tables of ``case.md``, with the text of their defaults."""
    rows = re.findall(r"^\| `([\w.*\[\]]+)` \| (.*?) ?\| .+ \|$", CASE_MD, re.MULTILINE)
    assert len(rows) == len({key for key, _ in rows}), "a key is described twice"
    return {key: default.strip("`") for key, default in rows}


def test_every_key_is_described_and_no_other() -> None:
    assert set(documented()) == {key for key, _ in keys(Case)}


@pytest.mark.parametrize(("key", "default"), dict(keys(Case)).items())
def test_defaults(key: str, default: object) -> None:
    text = documented()[key]
    if default is REQUIRED:
        assert text == ""
    else:
        plain = list(default) if isinstance(default, tuple) else default
        assert text != ""
        assert yaml.safe_load(text) == plain


# --- examples -----------------------------------------------------------------


def merged(base: Any, change: Any) -> Any:
    """A case with some keys replaced."""
    if not isinstance(base, dict) or not isinstance(change, dict):
        return change
    return base | {key: merged(base.get(key), value) for key, value in change.items()}


@each_block("yaml")
def test_yaml_examples_are_valid_cases(page: Path, block: str, tmp_path: Path) -> None:
    """A block is a whole case, or changes of the example mode1-small."""
    file = tmp_path / "case.yaml"
    file.write_text(block, encoding="utf-8")
    example = ROOT / "examples/mode1-small"
    change = yaml.safe_load(block)
    if "gimpmd" not in change:
        case = merged(yaml.safe_load((example / "case.yaml").read_text("utf-8")), change)
        file.write_text(yaml.safe_dump(case), encoding="utf-8")
    problems = [str(problem) for problem in check_case(load_case(file))]
    assert problems == []


LIVE = "README.md", "docs/architecture.md", "services/coupler/README.md"
"""Pages whose Python blocks take part in a run."""
CASES = {"services/gimp/README.md": "case.yaml"}
"""Files that the blocks of a page expect."""
BAR = """
gimpmd: 1
name: bar
units: lj
only: continuum
domain: {box: [[0, 32], [0, 16]]}
grid: {cell: 4}
time: {end: 10}
continuum: {material: {from: moduli, density: 0.93, lame: 27.8, shear: 27.8}}
output: {interval: 10}
"""


def run_block(block: str, folder: Path, *command: str) -> str:
    """Run a block in a folder; returns what it printed."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        [*command, block],
        cwd=folder,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, block + done.stderr
    return done.stdout


@pytest.mark.long
def test_examples_of_atomic_strain_run(tmp_path: Path) -> None:
    """All blocks of the page, one after the other in one folder."""
    text = (ROOT / "docs/atomic-strain.md").read_text(encoding="utf-8")
    found = re.findall(r"^```(python|sh)\n(.*?)^```", text, re.DOTALL | re.M)
    assert [language for language, _ in found] == ["python", "sh", "sh", "python"]
    for language, block in found:
        shell = (sys.executable, "-c") if language == "python" else ("sh", "-ec")
        said = run_block(block, tmp_path, *shell)
    assert {"plate.strain.dump", "green.dump", "virial.dump"} <= {
        p.name for p in tmp_path.iterdir()
    }
    assert float(said) == pytest.approx(0.049875, abs=1e-5)


OTHERWISE = {*LIVE, "docs/atomic-strain.md", "docs/python.md", "docs/run-folder.md"} | {
    "docs/tutorial-sides.md"
}
"""Pages whose Python blocks other tests run, here or in ``tests/deploy`` and ``tests/system``."""
PYTHON = [page for page in PAGES if blocks(page, "python") and name_of(page) not in OTHERWISE]


@pytest.mark.parametrize("page", PYTHON, ids=name_of)
def test_python_examples_run(page: Path, tmp_path: Path) -> None:
    """All Python blocks of a page, one after the other as in a notebook."""
    if name_of(page) in CASES:
        (tmp_path / CASES[name_of(page)]).write_text(BAR, encoding="utf-8")
    run_block("\n".join(blocks(page, "python")), tmp_path, sys.executable, "-c")


SOLVER = """
import sys
from pathlib import Path

import numpy as np

from gimpmd_coupler.loop import Timings
from gimpmd_coupler.participant import Participant
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.wire.energies import Energies

endpoint, run, run_dir = {endpoint!r}, "test", Path({run_dir!r})
plan = load_plan(run_dir / "plan.yaml")
box, node_ids = plan.domain.box, np.arange(10)
fields = {{"mass": np.ones(10), "velocity": np.ones((10, 2))}}
energies = Energies(kinetic=1.0, potential=0.0, external_work=0.0, interface_work=0.0,
                    dissipated=0.0, mass=1.0, momentum=(0.0, 0.0))
timings = {{"work": 0.1}}


class MySide:
    def __init__(self, plan):
        self.offers = self.needs = node_ids
        self.notes = ()
        self.timings = Timings()
        self.received = 0

    def zone_fields(self):
        return {{"velocity": np.ones((10, 2))}}

    def finish(self): pass
    def write(self, time): pass
    def close(self): pass
    def renew(self): pass
    def state(self): return {{"received": np.asarray(self.received)}}
    def findings(self): return ()

    def receive(self, fields):
        self.received += fields["mass"].sum() == 10

    def advance(self, fields=None):
        if fields is not None:
            self.receive(fields)

    def energies(self):
        return energies


solver = MySide(plan)
"""
"""What the blocks of ``LIVE`` take for granted."""


@pytest.mark.parametrize("page", ["README.md", "docs/architecture.md"])
def test_examples_of_services_take_part_in_a_run(
    page: str,
    start: Callable[..., Any],  # noqa: F811
    tmp_path: Path,
) -> None:
    """A page's continuum and the coupler's README's atoms, in one run from start to end."""
    run = start(md__ranks=1, time__end=1.6, record=True)
    prelude = SOLVER.format(endpoint=run.endpoint, run_dir=str(run.folder))
    programs = []
    for name in (page, "services/coupler/README.md"):
        (block,) = blocks(ROOT / name, "python")
        programs.append(
            subprocess.Popen(
                [sys.executable, "-c", prelude + block],
                stderr=subprocess.PIPE,
                text=True,
            )
        )
    for program in programs:
        _, stderr = program.communicate(timeout=60)
        assert program.returncode == 0, stderr
    assert run.coupler.end() == 0
    assert run.coupler.find(type="Ended", stopped=False)
    series, recording = blocks(ROOT / "docs/run-folder.md", "python")
    place = tmp_path / "runs/mode1-small"
    place.mkdir(parents=True)
    for name in ("run.h5", "recording.frames"):
        shutil.copy(run.folder / name, place)
    said = run_block(series + "print(len(time), len(balance))", tmp_path, sys.executable, "-c")
    assert said.split() == ["21", "21"]
    said = run_block(recording, tmp_path, sys.executable, "-c")
    assert said.split() == [word for step in range(21) for word in (str(step), "1.0")]


@each_block("sh")
def test_commands_exist(page: Path, block: str) -> None:
    """Every ``gimpmd`` command of a block exists and has the options, and every make target."""
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for line in block.splitlines():
        words = line.split("#")[0].replace("[", "").replace("]", "").split()
        if words[:1] == ["make"]:
            (target, *_) = [word for word in words[1:] if "=" not in word]
            assert f"\n{target}:" in makefile, line
        if words[:1] == ["gimpmd"]:
            command: Any = typer.main.get_command(app)
            rest = words[1:]
            while hasattr(command, "commands"):
                assert rest[0] in command.commands, line
                command = command.commands[rest.pop(0)]
            known = {option for parameter in command.params for option in parameter.opts}
            assert {word for word in rest if word.startswith("--")} <= known, line


# --- names and links -----------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in titles}


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text("utf-8")):
        target, _, anchor = link.partition("#")
        file = page.parent / target if target else page
        assert file.exists(), link
        assert not anchor or anchor in anchors(file), link


@each_page
def test_named_files_and_modules_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:schemas|services|deploy|examples|tests|docs)/[\w./-]+)`", text):
        assert (ROOT / name).exists(), name
    for name in re.findall(r"\b(?:pytest|python) (tests/[\w./ ]+)", text):
        for path in name.split():
            assert (ROOT / path).exists(), path
    for name in re.findall(r"python -m (tests\.[\w.]+)", text):
        path = ROOT / name.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").exists(), name
    for name in re.findall(r"`(gimpmd_\w+(?:/\w+)*/(?:\w+\.py)?)`", text):
        assert list(ROOT.glob(f"*/{name}")) + list(ROOT.glob(f"*/*/{name}")), name
    for name in re.findall(r"`(gimpmd_\w+(?:\.\w+)+)`", text):
        assert exists(name), name


def exists(name: str) -> bool:
    """Whether a dotted name is a module, or something in a module."""
    module, _, attribute = name.rpartition(".")
    try:
        importlib.import_module(name)
    except ImportError:
        return hasattr(importlib.import_module(module), attribute)
    return True


ROOMS = {
    "docs/architecture.md": "schemas/gimpmd_schemas",
    "services/coupler/README.md": "services/coupler/gimpmd_coupler",
    "services/gimp/README.md": "services/gimp/gimpmd_gimp",
    "services/md/README.md": "services/md/gimpmd_md",
}


@pytest.mark.parametrize(("page", "package"), ROOMS.items())
def test_every_room_is_listed_and_no_other(page: str, package: str) -> None:
    """The table of rooms or modules names every module and folder at the top of the package."""
    rows = re.findall(
        r"^\| (?:room|module)[^\n]*\n\|[-|]+\n((?:\|.*\n)+)",
        (ROOT / page).read_text("utf-8"),
        re.MULTILINE,
    )
    listed = {
        cell.strip("`/").removesuffix(".py")
        for table in rows
        for row in table.splitlines()
        for cell in row.split("|")[1].split(", ")
        for cell in [cell.strip()]
    }
    there = {
        entry.stem
        for entry in (ROOT / package).iterdir()
        if (entry.suffix == ".py" or (entry / "__init__.py").exists()) and entry.stem != "__init__"
    }
    assert listed == there


@each_page
def test_named_tests_exist(page: Path) -> None:
    """A test is named as ``tests/PATH.py::NAME``, in a table also without ``tests/``."""
    named = re.findall(r"`(?:tests/)?([\w/]+\.py)::(\w+)", page.read_text("utf-8"))
    for path, name in named:
        assert f"def {name}(" in (ROOT / "tests" / path).read_text("utf-8"), (path, name)


def test_every_module_says_what_it_does() -> None:
    """The READMEs promise it."""
    for house in ("schemas", "services", "deploy"):
        for module in ROOT.glob(f"{house}/**/gimpmd_*/**/*.py"):
            assert ast.get_docstring(ast.parse(module.read_text("utf-8"))), module


def test_glossary_is_sorted_into_tables_without_doubles() -> None:
    text = (ROOT / "docs/glossary.md").read_text("utf-8")
    terms = re.findall(r"^\| (?!term|---)([^|]+?) \|", text, re.MULTILINE)
    assert len(terms) == len(set(terms)) > 50


def test_run_folder_names_every_series() -> None:
    text = (ROOT / "docs/run-folder.md").read_text(encoding="utf-8")
    for who, table in (("<role>", ENERGY_FIELDS), ("total", TOTAL_FIELDS)):
        for field in table:
            for name in field.components(3):
                assert f"`/series/{who}/{name}`" in text
