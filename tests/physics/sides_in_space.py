"""One wave in three dimensions for every pair of codes, coupled by the sites scheme.

A P wave of 8 cells leaves a slab of copper. A pair that cannot run it says why; LAMMPS with GIMP
must. A pair that runs it must keep the bounds, whoever it is.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec

from gimpmd_deploy.results.run import Run
from gimpmd_deploy.verify.crossing import crossing
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.errors import InputError
from tests.copper_sites import REFLECTED, TRANSMITTED, wave_case, write_scripts
from tests.physics.interface.running import new_folder
from tests.physics.sides import CONTINUA, MD, PROGRAM
from tests.physics.strips import LONGEST

MUST_RUN = (("lammps", "gimp"),)
"""Pairs that may not refuse the wave."""


@dataclass(frozen=True)
class Crossed:
    """What has become of the wave with a pair of codes.

    Attributes
    ----------
    run : the finished run; None if the pair refuses it.
    reason : why it does, or why the run failed.
    refused : whether the pair refuses the wave, as bad input.
    """

    run: Run | None
    reason: str = ""
    refused: bool = False


def cross(folder: Path, md: str, continuum: str) -> Crossed:
    """Run the wave with two codes by the command."""
    write_scripts(folder)
    case = wave_case("P")
    case["md"]["backend"] = md
    chosen = {"command": [str(PROGRAM)]} if continuum == "foreign" else {"backend": continuum}
    case["continuum"] |= chosen
    dump_case(msgspec.convert(case, Case), folder / "case.yaml")
    words = ["run", str(folder / "case.yaml"), "--out", str(folder / "run"), "--no-figures"]
    done = subprocess.run(
        [sys.executable, "-m", "gimpmd_deploy.cli.app", *words],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    if done.returncode == 0:
        return Crossed(Run(folder / "run"))
    return Crossed(None, reason_of(done.stderr), done.returncode == InputError.exit_code)


def reason_of(said: str) -> str:
    """The first problem of an error message, or the last words of a log in it, in one line."""
    lines = [line.strip() for line in said.splitlines()]
    problems = [line.removeprefix("- ") for line in lines if line.startswith("- ")]
    logged = [lines[k + 1] for k, line in enumerate(lines[:-1]) if line.startswith("end of ")]
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    return (problems or logged or errors or lines[-1:] or ["no reason was given"])[0]


def table(chosen: list[str]) -> tuple[list[str], bool]:
    """Lines of the table, and whether all pairs that run keep the bounds."""
    lines = [
        "| pair, in space | R | T | largest energy imbalance | wall time per step, ms | bounds |",
        "|---|---|---|---|---|---|",
    ]
    kept = True
    for md in [name for name in MD if name in chosen]:
        for continuum in [name for name in CONTINUA if name in chosen]:
            found = cross(new_folder(), md, continuum)
            may_refuse = found.refused and (md, continuum) not in MUST_RUN
            if found.run is None:
                kept &= may_refuse
                verdict = "not run" if may_refuse else "BROKEN"
                lines.append(f"| {md}, {continuum} | | | | | {verdict}: {found.reason} |")
                continue
            R, T = crossing(found.run)
            passed = R < REFLECTED and TRANSMITTED[0] < T < TRANSMITTED[1]
            kept &= passed
            energies, steps = found.run.energies, len(found.run.energies.time) - 1
            wall = 1e3 * sum(found.run.timings.totals()["md"].values()) / steps
            lines.append(
                f"| {md}, {continuum} | {R:.4f} | {T:.4f} | {energies.largest_imbalance():.1e} "
                f"| {wall:.1f} | {'kept' if passed else 'BROKEN'} |"
            )
    return lines, kept
