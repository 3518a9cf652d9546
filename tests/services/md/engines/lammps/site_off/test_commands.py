"""The potential of a LAMMPS log."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.site_off.commands import (
    Potential,
    find_file,
    numbers_of,
    potential_in,
)
from gimpmd_schemas.errors import BackendError

SCRIPT = """\
units metal
variable name index Cu
lattice fcc 3.6
region box block 0 2 0 2 0 2
create_box 2 box
create_atoms 1 region box
pair_style lj/cut 5.0
pair_coeff * * 1.0 1.0
mass * 1.0
if "${name} == Cu" then "include potential.in"
"""
POTENTIAL = """\
pair_style hybrid/overlay eam/alloy &
    zbl 1.0 2.0
pair_coeff * * eam/alloy Cu_mishin1.eam.alloy ${name} ${name} # both
variable i loop 2
label each
pair_coeff $i 2 zbl 29 29
next i
jump SELF each
pair_coeff 1 1 zbl 29 29
pair_modify shift no
"""


def test_includes_loops_and_variables_are_seen_through(folder: Path) -> None:
    (folder / "script.in").write_text(SCRIPT)
    (folder / "potential.in").write_text(POTENTIAL)
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    engine.script("script.in", {"name": "Cu"})
    engine.close()
    assert potential_in((folder / "log.lammps").read_text()) == Potential(
        style=("hybrid/overlay", "eam/alloy", "zbl", "1.0", "2.0"),
        coeffs=(
            ("*", "*", "eam/alloy", "Cu_mishin1.eam.alloy", "Cu", "Cu"),
            ("1", "2", "zbl", "29", "29"),
            ("2", "2", "zbl", "29", "29"),
            ("1", "1", "zbl", "29", "29"),
        ),
        modify=(("shift", "no"),),
    )


def test_a_log_without_potential_is_refused() -> None:
    with pytest.raises(BackendError, match="sets no pair_style"):
        potential_in("units metal\n")


@pytest.mark.parametrize(
    ("words", "numbers"), [("2", [2]), ("*", [1, 2, 3]), ("2*", [2, 3]), ("*2", [1, 2])]
)
def test_numbers_of_types(words: str, numbers: list[int]) -> None:
    assert list(numbers_of(words, 3)) == numbers


def test_a_missing_file_is_refused(folder: Path) -> None:
    with pytest.raises(BackendError, match=r"none.eam: no such potential file .* md.files"):
        find_file("none.eam")
