"""Whole runs by the command: a small cracked body, about 1,000 atoms."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from gimpmd_deploy.results.run import Run
from tests.cases import EXAMPLE, changed, small_case


class Command:
    """The command on a case in a folder of its own, with the example's scripts beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        for script in EXAMPLE.glob("*.in"):
            (folder / script.name).write_text(script.read_text())

    def write(self, case: dict[str, Any]) -> Path:
        """Write the case file."""
        path = self.folder / "case.yaml"
        path.write_text(yaml.safe_dump(case))
        return path

    def arguments(self, *words: str) -> list[str]:
        """Return the command line."""
        return [sys.executable, "-m", "gimpmd_deploy.cli.app", *words]

    def attempt(
        self, case: dict[str, Any], *options: str, name: str = "run", timeout: float = 200
    ) -> subprocess.CompletedProcess[str]:
        """Run the case, however it ends; without figures unless the options ask for them."""
        out = str(self.folder / name)
        return subprocess.run(
            self.arguments("run", str(self.write(case)), "--out", out, "--no-figures", *options),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    def run(
        self, case: dict[str, Any], *options: str, name: str = "run", timeout: float = 200
    ) -> Run:
        """Run the case to its end, and open the run."""
        done = self.attempt(case, *options, name=name, timeout=timeout)
        assert done.returncode == 0, done.stdout + done.stderr
        return Run(self.folder / name)


@pytest.fixture
def command(tmp_path):
    """A ``Command`` in a fresh folder."""
    return Command(tmp_path / "case")


@pytest.fixture
def case():
    """The small case, to change at will."""
    return small_case()


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Callable[..., Run]:
    """Return a finished run of the small case; each run takes place once in a session.

    Its arguments are changes of the case by dotted key, and options of the command. Tests must not
    change the run.
    """
    known: dict[str, Run] = {}

    def run(changes: dict[str, Any], *options: str) -> Run:
        key = repr((changes, options))
        if key not in known:
            command = Command(tmp_path_factory.mktemp("small") / "case")
            known[key] = command.run(changed(small_case(), changes), *options)
        return known[key]

    return run
