"""Meshes of cases that do not run yet: with and without what LAMMPS measures."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gimpmd_gimp.fem.check_mesh import check_mesh
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.coupling.test_force import H
from tests.services.gimp.fem.meshes import around
from tests.services.gimp.fem.test_body import OUTER, boxed_case

MESH = "m.vtu"
ROOM = (6 * H, 19 * H), (5 * H, 18 * H)
"""The MD region with two cells around it."""


def open_case(case: Case) -> Case:
    """The case before LAMMPS has measured it: without material and planes."""
    replace = msgspec.structs.replace
    material = MeasuredByMd(cell="bulk.in")
    return replace(
        case,
        continuum=replace(case.continuum, material=material),
        coupling=replace(case.coupling, planes=None),
    )


@pytest.mark.parametrize("change", [lambda case: case, open_case], ids=["measured", "open"])
def test_a_mesh_that_leaves_room_is_accepted(tmp_path: Path, change: object) -> None:
    around(tmp_path / MESH, OUTER, ROOM, H)
    check_mesh(change(boxed_case(MESH)), tmp_path)  # type: ignore[operator]


@pytest.mark.parametrize("change", [lambda case: case, open_case], ids=["measured", "open"])
def test_a_mesh_among_the_atoms_is_refused(tmp_path: Path, change: object) -> None:
    around(tmp_path / MESH, OUTER, ((10 * H, 15 * H), (9 * H, 14 * H)), H)
    with pytest.raises(BackendError, match=r"continuum\.mesh = 'm\.vtu': it has elements in"):
        check_mesh(change(boxed_case(MESH)), tmp_path)  # type: ignore[operator]


def test_the_time_step_is_checked_when_the_material_is_known(tmp_path: Path) -> None:
    around(tmp_path / MESH, OUTER, ROOM, H)
    long = boxed_case(MESH, time={"end": 400.0, "md_timestep": 0.1, "md_steps": 40})
    check_mesh(open_case(long), tmp_path)
    with pytest.raises(BackendError, match=r"time\.md_steps: steps of 4 are unstable in"):
        check_mesh(long, tmp_path)


def test_a_case_without_a_mesh_has_nothing_to_check(tmp_path: Path) -> None:
    check_mesh(boxed_case(None), tmp_path)


def test_a_file_that_is_no_mesh(tmp_path: Path) -> None:
    (tmp_path / MESH).write_text("no mesh")
    with pytest.raises(BackendError, match=r"continuum\.mesh = 'm\.vtu': meshio cannot read it"):
        check_mesh(boxed_case(MESH), tmp_path)
