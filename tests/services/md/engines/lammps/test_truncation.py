"""Jumps of pair potentials at their cutoffs."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.truncation import largest_jump, sentence

AT_CUTOFF = 4.0 * (2.5**-12 - 2.5**-6)
"""Lennard-Jones at a cutoff of 2.5."""

HEAD = """units lj
dimension 2
boundary p p p
region box block 0 10 0 10 -0.5 0.5
create_box 2 box
mass * 1
"""


def engine(folder: Path, potential: str) -> Engine:
    """LAMMPS with two types of atoms."""
    from mpi4py import MPI

    found = Engine(MPI.COMM_SELF, folder / "log.lammps")
    found.commands((HEAD + potential).splitlines())
    return found


def test_lennard_jones_jumps_by_its_value_at_the_cutoff(tmp_path: Path) -> None:
    """The pair of types with another cutoff jumps more."""
    lammps = engine(tmp_path, "pair_style lj/cut 2.5\npair_coeff * * 1 1\npair_coeff 1 2 1 1 1.6")
    jump = largest_jump(lammps, 2.5)
    assert jump is not None
    assert jump.types == (1, 2)
    assert jump.distance == pytest.approx(1.6, abs=1e-5)
    assert jump.energy == pytest.approx(4.0 * (1.6**-12 - 1.6**-6), rel=1e-4)
    assert jump.depth == pytest.approx(1.0, rel=1e-3)
    assert "-0.224 epsilon at its cutoff of 1.6" in sentence(jump, "a.in", "epsilon")
    lammps.commands(["pair_coeff * * 1 1 2.5"])
    jump = largest_jump(lammps, 2.5)
    assert jump is not None
    assert jump.energy == pytest.approx(AT_CUTOFF, rel=1e-4)
    lammps.close()


@pytest.mark.parametrize(
    "potential",
    [
        "pair_style lj/cut 2.5\npair_coeff * * 1 1\npair_modify shift yes",
        "pair_style lj/smooth/linear 2.5\npair_coeff * * 1 1",
        "pair_style soft 2.0\npair_coeff * * 1",
        "pair_style zero 2.5\npair_coeff * *",
    ],
)
def test_others_do_not_jump(tmp_path: Path, potential: str) -> None:
    lammps = engine(tmp_path, potential)
    assert largest_jump(lammps, 2.5) is None
    lammps.close()
