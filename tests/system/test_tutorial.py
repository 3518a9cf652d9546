"""The tutorial on writing both sides: its very text, installed and run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "tutorial-sides.md"


def blocks(language: str) -> list[str]:
    text = PAGE.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def sources() -> dict[str, str]:
    """The modules of the page by their names, which their first lines give."""
    found = {}
    for block in blocks("python"):
        if named := re.match(r"# (\w+\.py)\n", block):
            found[named[1]] = block
    return found


def test_each_side_takes_less_than_a_hundred_lines() -> None:
    counted = {
        name: sum(bool(line.strip()) for line in text.splitlines())
        for name, text in sources().items()
    }
    assert set(counted) == {"springs.py", "plate.py"}
    assert max(counted.values()) < 100, counted


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package of the page, as an installation makes it: modules and entry points."""
    (toml,) = blocks("toml")
    project = tomllib.loads(toml)["project"]
    package = tmp_path / "installed"
    info = package / "two_sides-1.dist-info"
    info.mkdir(parents=True)
    for name, text in sources().items():
        (package / name).write_text(text, encoding="utf-8")
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [
        line
        for group, entries in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.setenv("PYTHONPATH", str(package))
    return package


def test_a_wave_crosses_from_the_plate_to_the_springs(installed: Path, tmp_path: Path) -> None:
    (case,) = blocks("yaml")
    *_, check = blocks("python")
    (tmp_path / "case.yaml").write_text(case)
    gimpmd = [sys.executable, "-m", "gimpmd_deploy.cli.app"]
    said = run([*gimpmd, "backends"], tmp_path)
    assert "springs 1" in said
    assert "plate 1" in said
    (tmp_path / "none.yaml").touch()
    run([*gimpmd, "run", "case.yaml", "--out", "wave", "--no-figures"], tmp_path)
    print(run([sys.executable, "-c", check], tmp_path))


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        env=os.environ,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
