"""The record of a run: everything in ``run.h5``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py

from gimpmd_deploy.results.energies import RunEnergies
from gimpmd_deploy.results.findings import RunFinding, read_findings
from gimpmd_deploy.results.timings import Timings
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.record_format import check_format


@dataclass(frozen=True)
class Record:
    """What ``run.h5`` holds.

    Attributes
    ----------
    energies : RunEnergies
    timings : Timings
    findings : what monitors found, the first of each kind on each side.
    seconds : wall time, without pauses before a run was resumed; None while the run goes on.
    notes : what the user should know about the results, one sentence each.
    outcome : ``completed``, ``stopped``, ``running``, or which process was lost or failed.
    """

    energies: RunEnergies
    timings: Timings
    findings: tuple[RunFinding, ...]
    seconds: float | None
    notes: tuple[str, ...]
    outcome: str

    @classmethod
    def read(cls, path: Path) -> Record:
        """Read the record of a run, also while the run goes on.

        Raises
        ------
        InputError
            The run has not completed a step, or the file has another format.
        """
        with h5py.File(path, locking=False) as file:
            check_format(path, file)
            if "series" not in file:
                what = f"holds no step; outcome of the run: {file.attrs['outcome']}"
                raise InputError(
                    str(path), [Problem("series", None, what, "see the logs beside it")]
                )
            return cls(
                energies=RunEnergies.read(file["series"]),
                timings=Timings.read(file),
                findings=read_findings(file),
                seconds=float(file.attrs["wall_time"]) if "end" in file.attrs else None,
                notes=tuple(map(str, file.attrs.get("notes", ()))),
                outcome=str(file.attrs["outcome"]),
            )
