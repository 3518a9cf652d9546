"""Crystal structures of one element, in units of their lattice constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.wire.lattice import Structure

_ON_FACE = 1e-6


class Plane(NamedTuple):
    """A crystal plane that can be a surface.

    Attributes
    ----------
    name : its indices.
    axis : axis normal to it, in the cell with these axes.
    axes : crystal directions of the axes, as rows; None: the axes of the structure.
    """

    name: str
    axis: int
    axes: tuple[tuple[int, ...], ...] | None = None


@dataclass(frozen=True)
class Cell:
    """An upright cell of a structure.

    Attributes
    ----------
    edges : tuple of float
        Edges of the cell, in lattice constants.
    basis : tuple of tuple of float
        Positions of its atoms, in edges.
    planes : tuple of Plane
        Planes of low index.
    """

    edges: tuple[float, ...]
    basis: tuple[tuple[float, ...], ...]
    planes: tuple[Plane, ...]


_CUBE = (1.0, 1.0, 1.0)
_CUBIC_PLANES = (
    Plane("(111)", 2, ((1, -1, 0), (1, 1, -2), (1, 1, 1))),
    Plane("(100)", 2),
    Plane("(110)", 2, ((0, 0, 1), (1, -1, 0), (1, 1, 0))),
)
_FACES = ((0.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 0.5, 0.0))

CELLS: dict[Structure, Cell] = {
    "sc": Cell(_CUBE, ((0.0, 0.0, 0.0),), _CUBIC_PLANES),
    "bcc": Cell(_CUBE, ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)), _CUBIC_PLANES),
    "fcc": Cell(_CUBE, _FACES, _CUBIC_PLANES),
    "diamond": Cell(
        _CUBE,
        tuple(tuple(x + shift for x in place) for shift in (0.0, 0.25) for place in _FACES),
        _CUBIC_PLANES,
    ),
    "hcp": Cell(
        (1.0, 3.0**0.5, (8.0 / 3.0) ** 0.5),
        ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 5.0 / 6.0, 0.5), (0.0, 1.0 / 3.0, 0.5)),
        (Plane("(0001)", 2), Plane("(10-10)", 1), Plane("(11-20)", 0)),
    ),
    "hex": Cell(
        (1.0, 3.0**0.5),
        ((0.0, 0.0), (0.5, 0.5)),
        (Plane("close-packed rows", 1), Plane("normal to close-packed rows", 0)),
    ),
    "sq": Cell((1.0, 1.0), ((0.0, 0.0),), (Plane("(10)", 0),)),
}
"""Upright cells. In ``hex`` the close-packed rows lie along x; in ``hcp`` x is [11-20]."""

DIRECTIONS: Mapping[int, Mapping[str, tuple[int, ...]]] = {
    2: {"[10]": (1, 0), "[11]": (1, 1)},
    3: {"[100]": (1, 0, 0), "[110]": (1, 1, 0), "[111]": (1, 1, 1)},
}
"""Main directions of square and cubic structures, by the number of dimensions."""


def atoms(structure: Structure, axes: tuple[tuple[int, ...], ...] | None) -> tuple[Floats, Floats]:
    """Edges ``(d,)`` and atoms ``(n, d)`` of a cell with some axes, in lattice constants.

    Parameters
    ----------
    axes : tuple, optional
        Crystal directions of the axes of a cubic structure, normal to each other.
    """
    cell = CELLS[structure]
    edges = np.array(cell.edges)
    rows = np.eye(len(edges)) * edges if axes is None else np.array(axes, float)
    lengths = np.linalg.norm(rows, axis=1)
    far = int(np.abs(rows).sum(axis=0).max()) + 1
    corners = np.array(list(product(range(-far, far + 1), repeat=len(edges))))
    places = (corners[:, None] + np.array(cell.basis)).reshape(-1, len(edges)) * edges
    turned = places @ (rows / lengths[:, None]).T
    inside = ((turned > -_ON_FACE) & (turned < lengths - _ON_FACE)).all(axis=1)
    return lengths, turned[inside]
