"""Files that LAMMPS reads for a run."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_schemas.case.derive.scripts import scripts
from gimpmd_schemas.case.form import Case

Make = Callable[..., Case]
MEASURED = {"from": "md", "cell": "cell.in"}


def test_scripts_with_their_keys(make: Make) -> None:
    case = make(md__after="after.in", md__files=["table.txt"], continuum__material=MEASURED)
    assert scripts(case) == [
        ("md.input", "md.in"),
        ("md.after", "after.in"),
        ("continuum.material.cell", "cell.in"),
        ("md.files[0]", "table.txt"),
    ]


def test_a_continuum_with_known_moduli_reads_none(make: Make) -> None:
    assert scripts(make(only="continuum", md__files=["table.txt"])) == []
    alone = make(only="continuum", md__files=["table.txt"], continuum__material=MEASURED)
    assert scripts(alone) == [("continuum.material.cell", "cell.in"), ("md.files[0]", "table.txt")]
