"""The runs behind the tables: examples with some keys changed, each made once.

A run that has been completed in the folder of runs is opened, not repeated, so a study that takes
hours can be interrupted between two runs and goes on where it was.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import InputError
from tests.cases import changed

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@dataclass(frozen=True)
class Job:
    """A run of an example.

    Attributes
    ----------
    name : of the run, and of its folder.
    example : folder of the example.
    changes : keys of the case, dotted, and their new values.
    options : further options of ``gimpmd run``.
    """

    name: str
    example: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    options: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """What a user writes, after the changes have been made in the case."""
        return " ".join(["gimpmd run", f"examples/{self.example}/case.yaml", *self.options])


def finished(job: Job, folder: Path) -> Run:
    """Open the run of a job; if it was not completed before, run it first.

    Raises
    ------
    RuntimeError
        The run failed; the message is that of ``gimpmd run``.
    """
    out = folder / job.name
    run = _completed(out)
    if run is not None:
        return run
    source = folder / f"{job.name}-case"
    shutil.copytree(EXAMPLES / job.example, source, dirs_exist_ok=True)
    case = yaml.safe_load((source / "case.yaml").read_text())
    (source / "case.yaml").write_text(yaml.safe_dump(changed(case, job.changes)))
    command = [sys.executable, "-m", "gimpmd_deploy.cli.app", "run", str(source / "case.yaml")]
    done = subprocess.run([*command, "--out", str(out), "--force", *job.options], check=False)
    if done.returncode:
        raise RuntimeError(f"{job.name} ended with exit code {done.returncode}")
    return Run(out)


def _completed(out: Path) -> Run | None:
    try:
        run = Run(out)
        return run if run.outcome == "completed" else None
    except InputError:  # nothing there, or the rest of a run that was interrupted
        return None
