"""Stress at rest of the atoms that the material points follow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]

HOLE = "region hole cylinder z 26 26 5 INF INF units box\ndelete_atoms region hole\n"


@pytest.mark.parametrize("hole", [False, True])
def test_a_hole_leaves_stress_where_the_points_follow_the_atoms(
    start: Start, make: Make, folder: Path, hole: bool
) -> None:
    """The perfect crystal is at zero pressure; the surface of a hole pulls on it."""
    script = folder / "block.in"
    script.write_text(script.read_text() + (HOLE if hole else ""))
    side = start(make(md__minimize=True, md__variables={"shift": "yes"}))
    assert len(side.notes) == hole
    assert all("of C11) that the points do not have" in note for note in side.notes)
