"""Meshes from files: what is read, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from gimpmd_gimp.fem.mesh_file import read_mesh
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.fem.meshes import block

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 0]])
QUAD: list[Any] = [("line", [[0, 1]]), ("quad", [[0, 1, 2, 3]]), ("vertex", [[4]])]


@pytest.mark.parametrize("suffix", ["msh", "vtu", "vtk", "inp", "bdf", "mesh"])
def test_common_formats_are_read(tmp_path: Path, suffix: str) -> None:
    """Gmsh, VTK, Abaqus, Nastran and Medit, as meshio writes them."""
    file = block(tmp_path / f"m.{suffix}", (3, 2), "quad", shake=0.0)
    mesh = read_mesh(tmp_path, file.name, 2)
    assert list(mesh.cells) == ["quad"]
    assert mesh.cells["quad"].shape == (6, 4)
    np.testing.assert_allclose(mesh.x.max(axis=0), [3.0, 2.0])


def test_points_and_lines_are_left_out(tmp_path: Path) -> None:
    meshio.Mesh(SQUARE, QUAD).write(tmp_path / "m.vtk")
    mesh = read_mesh(tmp_path, "m.vtk", 2)
    np.testing.assert_array_equal(mesh.x, SQUARE[:4, :2])
    assert {kind: part.tolist() for kind, part in mesh.cells.items()} == {"quad": [[0, 1, 2, 3]]}


@pytest.mark.parametrize(
    ("points", "cells", "dim", "words"),
    [
        (SQUARE, QUAD, 3, "has no hexahedra or tetrahedra, only line, quad, vertex; from gmsh"),
        (SQUARE, [("line", [[0, 1]])], 2, "has no quadrilaterals or triangles, only line"),
        (SQUARE + [[0, 0, z] for z in (0, 0, 1, 0, 0)], QUAD, 2, "do not lie in a plane"),
        (SQUARE * np.nan, QUAD, 2, "coordinates that are not finite"),
        (
            np.random.default_rng(0).uniform(size=(8, 3)) * [1, 1, 0],
            [("quad8", [list(range(8))])],
            2,
            "elements of the kind quad8; write quadrilaterals or triangles of first order",
        ),
    ],
)
def test_a_mesh_without_the_right_elements_is_refused(
    tmp_path: Path, points: Any, cells: Any, dim: int, words: str
) -> None:
    meshio.Mesh(points, cells).write(tmp_path / "m.vtk")
    with pytest.raises(BackendError, match=rf"^continuum.mesh = 'm.vtk': it.*{words}"):
        read_mesh(tmp_path, "m.vtk", dim)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("m.msh", b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 2"),
        ("m.vtu", b"not a mesh"),
        ("m.doc", b""),
        ("m.msh", bytes(range(256))),
    ],
)
def test_a_file_that_cannot_be_read_is_refused(
    tmp_path: Path, name: str, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BackendError, match=f"continuum.mesh = '{name}': meshio cannot read it"):
        read_mesh(tmp_path, name, 2)
    assert capsys.readouterr() == ("", "")
