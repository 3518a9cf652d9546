"""Meshes joined to cells of the grid: what is filled, and what does not fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_gimp.fem.joining import JoinedMesh, join_mesh
from gimpmd_gimp.fem.mesh_file import MeshFile, read_mesh
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.coupling.test_force import H
from tests.services.gimp.fem.meshes import SIDES, around
from tests.services.gimp.fem.test_body import OUTER, boxed
from tests.services.gimp.fem.test_fem import plan_of

BODY = ((0.0, 12.0), (0.0, 10.0))
HOLE = ((4.0, 8.0), (3.0, 7.0))


def joined(plan: Any, file: MeshFile) -> JoinedMesh:
    """The mesh of a plan."""
    interfaces = plan.coupling.interfaces if plan.coupling else ()
    absorbs = plan.coupling is not None and plan.coupling.absorber is not None
    return join_mesh(plan.background_grid(), interfaces, file, absorbs)


def join(
    folder: Path,
    change: Callable[[MeshFile], MeshFile] = lambda file: file,
    sides: tuple[str, ...] = SIDES,
    hole: Any = HOLE,
    **domain: Any,
) -> JoinedMesh:
    """A body of 12 x 10 cells with a mesh around a hole."""
    around(folder / "m.vtu", BODY, hole, 1.0, sides)
    plan = plan_of((12, 10), **domain)
    return joined(plan, change(read_mesh(folder, "m.vtu", 2)))


def moved(at: tuple[float, float], to: tuple[float, float]) -> Callable[[MeshFile], MeshFile]:
    """Move one vertex."""

    def change(file: MeshFile) -> MeshFile:
        x = file.x.copy()
        (chosen,) = np.flatnonzero(np.abs(x - at).max(axis=1) < 1e-9)
        x[chosen] = to
        return MeshFile(file.name, x, file.cells)

    return change


def without(last: int) -> Callable[[MeshFile], MeshFile]:
    """Leave out the last elements."""
    return lambda file: MeshFile(file.name, file.x, {"quad": file.cells["quad"][:-last]})


def slid(file: MeshFile) -> MeshFile:
    """Move a vertex along the upper face."""
    x = file.x.copy()
    x[np.flatnonzero((x[:, 1] == 10.0) & (x[:, 0] > 0.0))[0], 0] += 0.1
    return MeshFile(file.name, x, file.cells)


def test_what_the_mesh_leaves_open_is_filled(tmp_path: Path) -> None:
    joined = join(tmp_path)
    assert joined.window.origin == (4.0, 3.0)
    assert joined.window.cells == (4, 4)
    assert joined.filled.all()
    own = np.unique(np.concatenate([part.corners.ravel() for part in joined.parts]))
    both = np.intersect1d(own, joined.window_row)
    assert both.size == 16  # the nodes at the rim of the hole belong to both
    grid = plan_of((12, 10)).background_grid()
    held = np.flatnonzero(joined.row >= 0)
    assert held.size == 25
    np.testing.assert_allclose(joined.nodes[joined.row[held]], grid.positions()[held])


def test_single_precision_is_enough(tmp_path: Path) -> None:
    """Vertices at the hole and on the faces are moved to their exact places."""

    def rounded(file: MeshFile) -> MeshFile:
        return MeshFile(file.name, file.x + 3e-5 * np.sin(1e3 * file.x), file.cells)

    joined = join(tmp_path, rounded)
    for axis, end in ((0, 12.0), (1, 10.0)):
        x = joined.nodes[:, axis]
        assert (x == end).sum() == 5
        assert not ((x != end) & (abs(x - end) < 1e-3)).any()


def test_a_mesh_of_the_whole_body_leaves_nothing_open(tmp_path: Path) -> None:
    joined = join(tmp_path, sides=("left",), hole=((12.0, 12.0), (0.0, 10.0)))
    assert not joined.filled.any()
    assert (joined.row < 0).all()


def test_a_part_at_a_face_is_filled(tmp_path: Path) -> None:
    """Half of a strip that is periodic along y; nodes on its faces belong together."""
    joined = join(
        tmp_path, sides=("left",), hole=((6.0, 12.0), (0.0, 10.0)), domain__periodic=[False, True]
    )
    assert joined.window.cells == (6, 10)
    assert joined.filled.all()
    assert joined.nodes[:, 1].max() < 9.5
    assert len(np.unique(joined.nodes.round(9), axis=0)) == len(joined.nodes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (moved((0.0, 0.0), (-0.1, 0.0)), r"vertex at \(-0.1, 0\) and 0 others lie outside domain"),
        (moved((4.0, 4.0), (4.0, 4.1)), r"edge \(4, \d\S*\) to \(4, \S*\) belongs to one element"),
        (moved((12.0, 10.0), (11.5, 9.5)), "belongs to one element only"),
        (without(1), "belongs to one element only"),
        (
            lambda f: MeshFile(f.name, f.x, {"quad": np.concatenate([f.cells["quad"]] * 3)}),
            "more than two elements share the edge",
        ),
    ],
    ids=["outside", "not at a node", "off the face", "element left out", "elements twice"],
)
def test_a_mesh_that_does_not_fit_is_refused(tmp_path: Path, change: Any, words: str) -> None:
    with pytest.raises(BackendError, match=rf"^continuum.mesh = 'm.vtu': .*{words}"):
        join(tmp_path, change)


def test_a_hole_that_is_not_closed_is_refused(tmp_path: Path) -> None:
    """Two elements on each side of a slit that is one cell long."""
    x = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2], [1, 1]])
    slit = [[0, 1, 4, 3], [1, 2, 5, 9], [3, 4, 7, 6], [9, 5, 8, 7]]
    plan = plan_of((2, 2))
    file = MeshFile("m.vtu", x.astype(float), {"quad": np.array(slit)})
    with pytest.raises(BackendError, match="are not closed, together with the faces"):
        joined(plan, file)


def test_elements_that_cover_a_part_twice_are_refused(tmp_path: Path) -> None:
    x = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], float)
    file = MeshFile("m.vtu", np.concatenate([x, x]), {"quad": np.arange(8).reshape(2, 4)})
    plan = plan_of((2, 2))
    with pytest.raises(BackendError, match=r"cover 8, but domain.box has 4; the mesh must fill"):
        joined(plan, file)


def test_a_folded_element_is_refused(tmp_path: Path) -> None:
    x = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], float)
    file = MeshFile("m.vtu", x, {"quad": np.array([[0, 2, 1, 3]])})
    plan = plan_of((2, 2))
    with pytest.raises(BackendError, match=r"continuum.mesh = 'm.vtu'"):
        joined(plan, file)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (slid, r"vertex at \(\S+, \S+\) on a periodic face has no partner .* along y"),
        (without(6), "belongs to one element only"),
    ],
)
def test_periodic_faces_must_match(tmp_path: Path, change: Any, words: str) -> None:
    with pytest.raises(BackendError, match=words):
        join(
            tmp_path, change, ("left",), ((6.0, 12.0), (0.0, 10.0)), domain__periodic=[False, True]
        )


def test_cells_at_one_periodic_face_only_are_refused(tmp_path: Path) -> None:
    """Twelve squares on a side of a strip, all but the last one."""
    hole = ((4.0, 8.0), (6.0, 10.0))
    with pytest.raises(BackendError, match=r"no partner|differs at the two periodic faces"):
        join(tmp_path, sides=("left", "right", "bottom"), hole=hole,
             domain__periodic=[False, True])  # fmt: skip


@pytest.mark.parametrize("inner", [((9 * H, 18 * H), (6 * H, 16 * H)), None])
def test_elements_among_the_ghost_atoms_are_refused(tmp_path: Path, inner: Any) -> None:
    """The box that must stay open is named: ghost atoms, and a cell beyond the planes."""
    sides = SIDES if inner else ("left",)
    around(tmp_path / "m.vtu", OUTER, inner or ((26 * H, 26 * H), (0.0, 24 * H)), H, sides)
    plan, box = boxed("m.vtu"), [[8 * H, 17 * H], [7 * H, 16 * H]]
    with pytest.raises(BackendError) as error:
        joined(plan, read_mesh(tmp_path, "m.vtu", 2))
    assert f"it has elements in the box {np.round(box, 9).tolist()}" in str(error.value)


def test_the_box_of_the_atoms_may_be_left_open_exactly(tmp_path: Path) -> None:
    around(tmp_path / "m.vtu", OUTER, ((8 * H, 17 * H), (7 * H, 16 * H)), H)
    plan = boxed("m.vtu")
    whole = joined(plan, read_mesh(tmp_path, "m.vtu", 2))
    assert whole.filled.size == 81
