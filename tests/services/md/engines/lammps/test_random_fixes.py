"""Fixes with random numbers: same bits after a checkpoint, and what is told of the others."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from mpi4py import MPI

from gimpmd_md.engines.lammps.random_fixes import RandomFix, fixes_in, not_repeated, seed_at
from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.checkpoint.manifest import folder_of, state_file
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from tests.services.md.block import ALONE
from tests.services.md.driving import advance_by, energies, total

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]

SCRIPTS = {
    "langevin": "fix press all addforce 0.01 0.0 0.0\nfix heat all langevin 0.1 0.1 0.5 4321\n",
    "csvr, by a loop": (
        "velocity all create 0.1 12345\n"
        "variable k loop 1 2\n"
        "label again\n"
        "fix heat$k all temp/csvr 0.1 0.1 0.5 $(100*v_k)\n"
        "next k\n"
        "jump SELF again\n"
        "compute moving all temp/com\n"
        "fix_modify heat2 temp moving\n"
    ),
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS.keys())
def test_a_run_goes_on_from_a_checkpoint_with_the_same_bits(
    start: Start, make: Make, folder: Path, script: str
) -> None:
    """The work of the fixes is that of the gain of energy after the checkpoint too."""
    (folder / "after.in").write_text(script)
    case = make(**ALONE, md__after="after.in", md__variables={"shift": "yes"})
    side = start(case)
    first = total(side)
    advance_by(side, 3)
    before = side.atoms.engine.fixes()
    side.renew()
    assert list(side.atoms.engine.fixes()) == list(before), "fixes keep their order"
    save_state(Path(), 3, "md", 0, side.state())
    saved = SavedStates(3, (folder_of(Path(), 3) / state_file("md", 0),), 0, 1)
    shutil.copytree("atoms", "other/atoms")
    advance_by(side, 20)
    work = energies(side).fix_work
    assert abs(work) > 0.1
    assert total(side) - first == pytest.approx(work, abs=2e-4 * total(side))

    other = open_side(make_plan(case), MPI.COMM_SELF, Path("other"), saved)
    advance_by(other, 20)
    for name, array in side.state().items():
        assert array.tobytes() == other.state()[name].tobytes(), name
    assert other.notes == ()
    other.close()


def test_a_seed_depends_on_the_users_seed_and_the_step() -> None:
    seeds = {seed_at(seed, step) for seed in range(1, 21) for step in range(0, 20000, 2000)}
    assert len(seeds) == 200
    assert all(0 < seed <= 800_000_000 for seed in seeds)


def test_the_last_definition_counts_with_its_changes() -> None:
    log = (
        "fix heat all langevin ${T} 1.0 0.5 7\n"
        "fix heat all langevin 2.0 1.0 0.5 7\n"
        "fix_modify heat temp one\n"
        "unfix heat\n"
        "fix heat hot langevin 3.0 3.0 0.5 8 zero yes  # warm\n"
        "fix_modify heat energy yes\n"
        "fix drude all langevin/drude 1 1 11 1 1 12\n"
        "fix press all indent 10.0 sphere 0 0 0 4.0\n"
    )
    fixes = {"heat": "langevin", "drude": "langevin/drude", "press": "indent"}
    heat, drude = fixes_in(log, fixes)
    assert " ".join(heat.words) == "heat hot langevin 3.0 3.0 0.5 8 zero yes"
    assert heat.anew(40) == [
        f"fix heat hot langevin 3.0 3.0 0.5 {seed_at(8, 40)} zero yes",
        "fix_modify heat energy yes",
    ]
    assert drude.anew(0) == [
        f"fix drude all langevin/drude 1 1 {seed_at(11, 0)} 1 1 {seed_at(12, 0)}"
    ]


def test_fixes_whose_numbers_begin_again_are_named() -> None:
    fixes = {"heat": "langevin", "hidden": "temp/csvr", "metal": "ttm/mod", "press": "indent"}
    heat = RandomFix(("heat", "all", "langevin", "1", "1", "1", "7"), (6,))
    hidden, metal = not_repeated(fixes, [heat])
    assert "the random numbers of fix hidden (temp/csvr) begin again" in hidden
    assert "fix metal (ttm/mod)" in metal


def test_a_script_that_hides_its_commands_from_the_log_is_told(
    start: Start, make: Make, folder: Path
) -> None:
    (folder / "after.in").write_text("echo none\n" + SCRIPTS["langevin"])
    side = start(make(**ALONE, md__after="after.in", md__variables={"shift": "yes"}))
    (note,) = side.notes
    assert "fix heat (langevin)" in note
