"""The command line in this process on a small case, and finished runs that tests share."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from filelock import FileLock
from typer.testing import CliRunner, Result

from gimpmd_deploy.cli.app import app
from gimpmd_deploy.results.run import Run
from tests.cases import ATOMS, CASE, changed

LONGEST = 120.0
"""Seconds after which a short run counts as hung."""


@dataclass
class Bench:
    """A folder with a case, and the command line."""

    folder: Path

    def write(self, changes: dict[str, Any] | None = None, script: str = ATOMS) -> Path:
        path = self.folder / "case.yaml"
        path.write_text(yaml.safe_dump(changed(CASE, changes or {})))
        (self.folder / "atoms.in").write_text(script)
        return path

    def gimpmd(self, *words: object) -> Result:
        return CliRunner().invoke(app, [str(word) for word in words])

    @property
    def runs(self) -> Path:
        return self.folder / "runs"


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.chdir(tmp_path)
    return Bench(tmp_path)


@pytest.fixture
def no_services(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Any attempt to start a service of a run fails the test."""

    def refuse(*_: object, **__: object) -> None:
        pytest.fail("a service was started")

    monkeypatch.setattr("gimpmd_deploy.launch.supervise.start", refuse)
    return lambda: None


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder with finished runs of the block: ``block``, ``block-md``, ``block-continuum``.

    They took ten coupling steps with output at 0, 0.4 and 0.8; ``block-md`` has no figures. Tests
    must not change them. All workers of a session share them: the first worker that needs them
    makes them.
    """
    if worker_id == "master":
        return _finished_runs(tmp_path_factory.mktemp("block"))
    folder = tmp_path_factory.getbasetemp().parent / "block"
    with FileLock(f"{folder}.lock", timeout=3 * LONGEST):
        if not folder.exists():
            _finished_runs(tmp_path_factory.mktemp("block")).parent.rename(folder)
    return folder / "runs"


def _finished_runs(folder: Path) -> Path:
    Bench(folder).write()
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "gimpmd_deploy.cli.app", "run", "case.yaml", *only],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for only in ((), ("--only", "md", "--no-figures"), ("--only", "continuum"))
    ]
    for run in started:
        output = run.communicate(timeout=LONGEST)[0]
        assert run.returncode == 0, output
        assert "finished at step 10 of 10, t = 0.8" in output
    return folder / "runs"


@pytest.fixture(scope="session")
def block(runs: Path) -> Run:
    """The coupled run of the block."""
    return Run(runs / "block")
