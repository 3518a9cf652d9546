"""The quarter-scale mode I crack of the examples, against pure MD of the whole domain.

Coupled to a Cauchy-Born continuum, and for comparison to a linear one, which does not soften in
tension as the atoms do: its front comes early.
"""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import gimpmd.analysis
from gimpmd_deploy.results.compare import Comparison, compare
from tests.physics.gimp.gates import Check
from tests.physics.interface.running import new_folder
from tests.physics.interface.schemes import COMPARED, SOURCE, SchemeName
from tests.physics.strips import Run, run_folder

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "mode1-small"

LIMITS = {30: (0.012, 0.012), 60: (0.012, 0.030)}
"""L2 error of u among the atoms and in the continuum."""
BALANCE = 0.006
BALANCE_OF_MD, STUDY = 1e-3, "the study has 1.3e-4"

HALF = {30: (0.012, 0.006), 60: (0.006, 0.015)}
"""The force scheme's: half of that, but for the atoms at t = 30, when the front has just come."""

PULL = 0.5
"""Traction that makes the crack grow; 0.3 does not."""
GROWN_AT = 70
GROWTH = 10.0
"""Least growth that is worth a comparison, in lattice spacings."""
GROWING = "tips within one lattice spacing"


def crack(scheme: SchemeName) -> list[Check]:
    """Errors of the displacement at all outputs from t = 30 on, and of the energy."""
    limits, source = (HALF, "half of acceptance") if scheme == "force" else (LIMITS, SOURCE)
    found = against_md(scheme, "cauchy-born")
    balance = BALANCE / 2 if scheme == "force" else BALANCE
    return [
        *errors(found, limits, source),
        Check("energy missing", found.balance_a, high=balance, source=source),
        Check("energy missing, pure MD", found.balance_b, high=BALANCE_OF_MD, source=STUDY),
        *errors(against_md(scheme, "linear"), {}, "", "linear, "),
    ]


def errors(
    found: Comparison, limits: dict[int, tuple[float, float]], source: str, label: str = ""
) -> list[Check]:
    """Errors of u at t = 30, 40, ...; times without limits are for comparison."""
    checks, rows = [], {round(row.time): row for row in found.differences}
    for time in range(30, max(rows) + 1, 10):
        row, highs = rows[time], limits.get(time, (np.inf, np.inf))
        places = {"MD": row.displacement_md, "continuum": row.displacement_continuum}
        for (place, error), high in zip(places.items(), highs, strict=True):
            checks.append(
                Check(
                    f"{label}t = {time}, L2 of u, {place}",
                    np.nan if error is None else error,
                    high=high,
                    source=source if time in limits else COMPARED,
                )
            )
    return checks


def growing(scheme: SchemeName) -> list[Check]:
    """A crack that grows, against pure MD: its tip at all outputs, and u at the end."""
    case = example() | {"coupling": {"scheme": scheme}}
    case["time"]["end"], case["output"]["interval"] = GROWN_AT, 2.0
    case["boundary"]["top"]["value"], case["boundary"]["bottom"]["value"] = [0, PULL], [0, -PULL]
    coupled, atoms = run(case), run(case, "--only", "md")
    found, spacing = compare(coupled, atoms), float(atoms.atoms().size[0, 0])
    tip, expected = (
        gimpmd.analysis.crack_growth(each).length / spacing for each in (coupled, atoms)
    )
    return [
        Check("growth in pure MD, spacings", np.ptp(expected), low=GROWTH, source=GROWING),
        Check("tips apart, spacings", abs(tip - expected).max(), high=1.0, source=GROWING),
        *errors(found, {GROWN_AT: HALF[60]}, "as without growth"),
        Check("energy missing", found.balance_a, high=BALANCE / 2, source="as without growth"),
    ]


def against_md(scheme: SchemeName, model: str) -> Comparison:
    """The coupled crack, compared with pure MD."""
    case = example()
    case["coupling"] = {"scheme": scheme}
    case["continuum"]["material"]["model"] = model
    return compare(run(case), pure_md())


@cache
def pure_md() -> Run:
    """All of it by atoms: minutes, so once for all schemes."""
    return run(example(), "--only", "md")


def example() -> dict[str, Any]:
    """The case file's values."""
    values: dict[str, Any] = yaml.safe_load((EXAMPLE / "case.yaml").read_text())
    return values


def run(case: dict[str, Any], *options: str) -> Run:
    """Run the case by the command, with the example's LAMMPS scripts beside it."""
    folder = new_folder()
    for script in EXAMPLE.glob("*.in"):
        shutil.copy(script, folder)
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    return run_folder(folder, *options)
