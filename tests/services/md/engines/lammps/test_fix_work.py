"""Work of the user's fixes: energy gained by the atoms is the work that the fixes have done."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_md.engines.lammps.fix_work import not_covered
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from tests.services.md.block import ALONE
from tests.services.md.driving import advance_by, energies, total

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]

INDENTER = (
    "variable low equal 30.0-0.5*step*dt\n"
    "fix press all indent 10.0 cylinder z 13 v_low 4.0 units box\n"
)
DRIVEN = (
    "region upper block INF INF 22 INF INF INF units box\n"
    "group upper region upper\n"
    "velocity upper set 0.0 0.1 0.0\n"
    "fix grip upper setforce 0.0 0.0 0.0\n"
)
SCRIPTS = {
    "indenter": INDENTER,
    "driven atoms": DRIVEN,
    "langevin": "fix heat all langevin 0.1 0.1 0.5 4321\n",
    "rescale": "velocity all create 0.2 12345\nfix heat all temp/rescale 10 0.1 0.1 0.001 1.0\n",
    "force": "fix push all addforce 0.1 0.0 0.0\nfix slow all viscous 0.3\n",
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS.keys())
def test_energy_is_the_work_of_the_fixes(
    start: Start, make: Make, folder: Path, script: str
) -> None:
    """To the accuracy at which velocity Verlet conserves energy (a part of 1e-4 at this step).

    The potential is zero at its cutoff, so the bonds that cross it do not matter.
    """
    (folder / "after.in").write_text(script)
    side = start(make(**ALONE, md__after="after.in", md__variables={"shift": "yes"}))
    first = total(side)
    advance_by(side, 50)
    work = energies(side).fix_work
    assert abs(work) > 0.1
    assert total(side) - first == pytest.approx(work, abs=2e-4 * total(side))


def test_without_fixes_nothing_is_measured(start: Start, make: Make, folder: Path) -> None:
    (folder / "after.in").write_text("fix mean all ave/time 1 1 20 c_thermo_temp\n")
    side = start(make(**ALONE, md__after="after.in", md__variables={"shift": "yes"}))
    assert "gimpmd_before" not in side.atoms.engine.fixes()
    advance_by(side, 1)
    assert energies(side).fix_work == 0.0
    assert side.notes == ()


def test_fixes_that_are_not_covered_are_named() -> None:
    fixes = {"press": "indent", "grow": "deposit", "mean": "ave/time"}
    assert not_covered("a.in", fixes, late=True) == [
        "the energy balance does not cover the work of fix grow (deposit) of a.in"
    ]
    (said,) = not_covered("b.in", fixes, late=False)
    assert said.startswith("the energy balance does not cover the work of the fixes press (indent)")
    assert "md.after" in said
