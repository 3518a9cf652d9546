"""The documentation keeps up with the code."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import msgspec
import pytest
import yaml

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import FACES, Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.wire.fields import ENERGY_FIELDS, TOTAL_FIELDS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("schemas/*.md")])
CASE_MD = (ROOT / "docs/case.md").read_text(encoding="utf-8")
REQUIRED = msgspec.NODEFAULT


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


def blocks(language: str) -> list[Any]:
    """Fenced blocks of a language in all pages."""
    return [
        pytest.param(text, id=f"{page.name}-{index}")
        for page in PAGES
        for index, text in enumerate(
            re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.M)
        )
    ]


@pytest.mark.parametrize("text", blocks("yaml"))
def test_yaml_examples_are_sound_cases(text: str, tmp_path: Path) -> None:
    file = tmp_path / "case.yaml"
    file.write_text(text, encoding="utf-8")
    assert [str(problem) for problem in check_case(load_case(file))] == []


def test_examples_of_atomic_strain_run(tmp_path: Path) -> None:
    """All blocks of the page, one after the other in one folder."""
    text = (ROOT / "docs/atomic-strain.md").read_text(encoding="utf-8")
    found = re.findall(r"^```(python|sh)\n(.*?)^```", text, re.DOTALL | re.M)
    assert [language for language, _ in found] == ["python", "sh", "sh", "python"]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    said = ""
    for language, block in found:
        shell = [sys.executable, "-c"] if language == "python" else ["sh", "-ec"]
        done = subprocess.run(
            [*shell, block],
            cwd=tmp_path,
            env=os.environ | {"PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, block + done.stderr
        said = done.stdout
    assert {"plate.strain.dump", "green.dump", "virial.dump"} <= {
        p.name for p in tmp_path.iterdir()
    }
    assert float(said) == pytest.approx(0.049875, abs=1e-5)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_named_files_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", text):
        assert (page.parent / target).exists(), target
    for name in re.findall(r"`((?:schemas|services|deploy|examples|tests|docs)/[\w./-]+)`", text):
        assert (ROOT / name).exists(), name
    for name in re.findall(r"`(gimpmd_\w+/\w+\.py)`", text):
        assert list(ROOT.rglob(name)), name


def test_run_folder_names_every_series() -> None:
    text = (ROOT / "docs/run-folder.md").read_text(encoding="utf-8")
    for who, table in (("<role>", ENERGY_FIELDS), ("total", TOTAL_FIELDS)):
        for field in table:
            for name in field.components(3):
                assert f"`/series/{who}/{name}`" in text


def test_architecture_names_every_module_of_the_contract() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    modules = {path.stem for path in ROOT.glob("schemas/gimpmd_schemas/[a-z]*.py")}
    assert {name for name in modules if f"`{name}`" not in text} == set()
