"""Atoms in LAMMPS: output, the script ``md.after``, the plane, and values that travel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import ALONE
from tests.services.md.driving import advance, advance_by

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]


def test_lammps_prints_and_so_tallies_at_common_times_alone(start: Start, make: Make) -> None:
    """At the last step of every run it would tally energy and stress of every atom."""
    case = make(**ALONE, grid__levels=[{"boxes": [[[0, 26], [0, 26]]]}])
    nested, steps = start(case), times.md_steps(case)
    for step in range(1, 5):
        advance_by(nested, 1)
        last = step * steps if step % 2 == 0 else (step - 1) * steps  # else at its start
        assert nested.atoms.engine.lammps.last_thermo_step == last


def test_migrations_change_when_atoms_may_have_changed_their_order(
    start: Start, make: Make
) -> None:
    atoms = start(make(**ALONE)).atoms
    first, before = atoms.site.copy(), atoms.migrations
    atoms.run(20)
    assert atoms.migrations == before  # at rest
    atoms.v[:] = np.random.default_rng(8).normal(scale=0.7, size=first.shape)
    for _ in range(24):
        before, order = atoms.migrations, atoms.site.copy()
        atoms.run(50)
        assert atoms.migrations != before or np.array_equal(atoms.site, order)
    assert not np.array_equal(atoms.site, first)  # LAMMPS sorts atoms once in 1000 steps


def test_dump_holds_displacements_and_both_references(
    start: Start, make: Make, folder: Path
) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    case = make(**ALONE, initial={"packets": [packet]}, output={"interval": 0.4})
    side = start(case)
    advance_by(side, 10)
    side.close()
    text = (folder / "atoms" / "atoms.dump").read_text()
    frames = text.split("ITEM: TIMESTEP\n")[1:]
    assert [int(frame.split("\n", maxsplit=1)[0]) for frame in frames] == [0, 200]
    head = frames[-1].split("ITEM: ATOMS ")[1].split("\n", maxsplit=1)[0].split()
    assert head == [
        "id",
        "type",
        "x",
        "y",
        "z",
        "vx",
        "vy",
        "ux",
        "uy",
        "X0",
        "Y0",
        "sxx_area",
        "syy_area",
        "sxy_area",
        "potential_energy",
        "mass",
    ]
    rows = np.array([row.split() for row in frames[-1].split("\n")[8:] if row], dtype=float)
    np.testing.assert_array_equal(rows[:, 0], np.arange(1, len(rows) + 1))
    assert np.abs(rows[:, 7:9]).max() > 1e-4
    relaxed = rows[:, 2:4] - rows[:, 7:9] - rows[:, 9:11]
    assert np.abs(relaxed).max() < 0.1
    r = pdist(rows[:, 2:4])
    pairs = np.where(r < 2.5, 4.0 * (r**-12 - r**-6), 0.0)
    assert rows[:, 14].sum() == pytest.approx(pairs.sum(), rel=1e-7)
    np.testing.assert_array_equal(rows[:, 15], 1.0)


def test_dump_holds_the_last_step(start: Start, make: Make, folder: Path) -> None:
    """The run has ten coupling steps of 20; outputs are three steps apart."""
    side = start(make(**ALONE, time__end=0.4, output={"interval": 0.12}))
    advance_by(side, 10)
    side.close()
    text = (folder / "atoms" / "atoms.dump").read_text()
    frames = text.split("ITEM: TIMESTEP\n")[1:]
    found = [int(frame.split("\n", maxsplit=1)[0]) for frame in frames]
    assert found == [0, 60, 120, 180, 200]


def test_after_script_sees_the_groups(start: Start, make: Make, folder: Path) -> None:
    (folder / "after.in").write_text("fix drag gimpmd_free viscous 0.1\n")
    side = start(make(md__after="after.in"))
    assert "drag" in side.atoms.engine.fixes()
    (folder / "after.in").write_text("fix move gimpmd_free nve\n")
    with pytest.raises(BackendError, match=r"after.in: fix move \(nve\) integrates"):
        start(make(md__after="after.in"))


def test_after_script_leaves_the_steps_alone(start: Start, make: Make, folder: Path) -> None:
    (folder / "after.in").write_text("reset_timestep 100\n")
    with pytest.raises(BackendError, match=r"after.in: LAMMPS is at step 100, not 0"):
        start(make(md__after="after.in"))


@pytest.mark.parametrize("after", [None, "after.in"])
def test_atoms_stay_in_the_plane(start: Start, make: Make, folder: Path, after: str | None) -> None:
    """By themselves, or by a fix where something of the user's might push them out."""
    (folder / "after.in").write_text("fix bath gimpmd_free langevin 0.1 0.1 0.5 42\n")
    side = start(make(md__after=after))
    assert ("gimpmd_plane" in side.atoms.engine.fixes()) == (after is not None)
    rng = np.random.default_rng(0)
    for _ in range(5):
        advance(side, rng.normal(scale=0.05, size=(side.needs.size, 2)))
    for name in "xv":
        in_plane, out_of_it = np.split(side.atoms.engine.atoms(name), [2], axis=1)
        assert np.ptp(in_plane) > 0.05
        assert not out_of_it.any()
