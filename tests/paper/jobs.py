"""The runs behind the tables: examples with some keys changed, each made once.

A run of the same case that has been completed in the folder of runs is opened, not repeated, so a
study that takes hours can be interrupted between two runs and goes on where it was.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import InputError
from tests.cases import changed

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
QUARTER = 4.0
"""Lengths and times of the full size over those of ``mode1-small``."""
CELL = 4.0
"""Cells of the finest level, at both sizes."""
KEEP_ALL = {"scheme": "velocity", "zones": {"inner": 294.0}}
"""Coupling whose inner zone reaches the crack of ``mode1``: points in the MD region are kept."""


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

    def case(self) -> dict[str, Any]:
        """Return the values of the case with the changes made."""
        values = yaml.safe_load((EXAMPLES / self.example / "case.yaml").read_text())
        return changed(values, dict(self.changes))

    def quarter(self) -> Job:
        """Return the same run of ``mode1-small``.

        Lengths and times are a quarter as large, and loads twice as large, so that the energy
        release rate is the same.
        """
        if self.example == "mode1-small":
            return self
        return replace(self, example="mode1-small", changes=_quarter(self.case()))


def _quarter(case: Mapping[str, Any]) -> dict[str, Any]:
    """Changes of ``mode1-small`` for a case of ``mode1``."""
    changes: dict[str, Any] = {
        "time.end": case["time"]["end"] / QUARTER,
        "time.md_steps": case["time"]["md_steps"],
        "output.interval": case["output"]["interval"] / QUARTER,
        "output.figures": case["output"].get("figures", ["sigma_yy"]),
    }
    for face in ("top", "bottom"):
        load = case["boundary"][face]
        changes[f"boundary.{face}.value"] = [QUARTER**0.5 * value for value in load["value"]]
        if "history" in load:
            history = [[time / QUARTER, factor] for time, factor in load["history"]]
            changes |= {f"boundary.{face}.history": history, f"boundary.{face}.ramp": 0.0}
    if "coupling" in case:
        coupling = dict(case["coupling"])
        if "zones" in coupling:  # one cell wide at both sizes is the outer zone, before the inner
            depth = (coupling["zones"]["inner"] + CELL) / QUARTER
            coupling["zones"] = {"inner": depth - CELL}
        changes["coupling"] = coupling
    return changes


def finished(job: Job, folder: Path) -> Run:
    """Open the run of a job; if it was not completed before, run it first.

    Raises
    ------
    RuntimeError
        The run failed; the message is that of ``gimpmd run``.
    """
    out, source = folder / job.name, folder / f"{job.name}-case"
    case = yaml.safe_dump(job.case())
    run = _completed(out)
    if run is not None and (source / "case.yaml").read_text() == case:
        return run
    shutil.copytree(EXAMPLES / job.example, source, dirs_exist_ok=True)
    (source / "case.yaml").write_text(case)
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
