"""Meshes from files, in every format that meshio reads."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import meshio
import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError

KINDS: dict[int, dict[str, str]] = {
    2: {"quad": "quadrilaterals", "triangle": "triangles"},
    3: {"hexahedron": "hexahedra", "tetra": "tetrahedra"},
}
"""Kinds of elements that are read, as meshio names them, and in words, by dimension."""

FLAT = 1e-6
"""Largest spread of z, over the size of the mesh, in a file of a plane mesh."""


@dataclass(frozen=True, eq=False)
class MeshFile:
    """Vertices and elements of a file.

    Attributes
    ----------
    name : str
        Name of the file, for messages.
    x : ndarray, shape ``(n, d)``
        Vertices of elements (length). Other points of the file are left out.
    cells : dict of str to ndarray, shape ``(m, corners)``
        Vertices of the elements of each kind, in the order of meshio, which is that of VTK.
    """

    name: str
    x: Floats
    cells: dict[str, Ints]

    def refuse(self, message: str) -> NoReturn:
        """Refuse the mesh.

        Raises
        ------
        BackendError
        """
        raise BackendError(f"continuum.mesh = {self.name!r}: {message}")


def read_mesh(folder: Path, name: str, dim: int) -> MeshFile:
    """Read the elements of a file that have as many dimensions as the body.

    Elements of fewer dimensions, such as lines on the boundary, are left out.

    Raises
    ------
    BackendError
        The file cannot be read, or it has no such elements, or others than of first order.
    """
    empty = MeshFile(name, np.empty((0, dim)), {})
    mesh = _read(folder / name, empty)
    known, kinds = KINDS[dim], sorted({block.type for block in mesh.cells})
    wrong = {block.type for block in mesh.cells if block.dim == dim} - set(known)
    if wrong:
        empty.refuse(
            f"it has elements of the kind {', '.join(sorted(wrong))}; write "
            f"{' or '.join(known.values())} of first order"
        )
    cells = {
        kind: np.concatenate(blocks).astype(np.int64)
        for kind in known
        if (blocks := [block.data for block in mesh.cells if block.type == kind and len(block)])
    }
    if not cells:
        empty.refuse(
            f"it has no {' or '.join(known.values())}, only {', '.join(kinds) or 'points'}; from "
            "gmsh, save all elements (Mesh.SaveAll), or make the body a physical group"
        )
    x = np.zeros((len(mesh.points), max(3, dim)))
    x[:, : mesh.points.shape[1]] = mesh.points
    used = np.unique(np.concatenate([part.ravel() for part in cells.values()]))
    x = x[used]
    if not np.isfinite(x).all():
        empty.refuse("it has coordinates that are not finite")
    if np.ptp(x[:, dim:], axis=0).max(initial=0.0) > FLAT * np.ptp(x[:, :dim], axis=0).max():
        empty.refuse("its vertices do not lie in a plane of constant z; make a plane mesh")
    return MeshFile(
        name,
        np.ascontiguousarray(x[:, :dim]),
        {kind: np.searchsorted(used, part) for kind, part in cells.items()},
    )


def _read(path: Path, empty: MeshFile) -> meshio.Mesh:
    """Read a file; meshio prints what is wrong and exits, or lets any error of a parser pass."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        words = " ".join(said.getvalue().split()) or f"{type(error).__name__}: {error}"
        empty.refuse(f"meshio cannot read it ({words}); save it as .msh or .vtu, for example")
