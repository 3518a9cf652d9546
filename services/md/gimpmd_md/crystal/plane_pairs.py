"""Places of the two planes of a face: midway between layers of atoms, and clear of node lines.

Nodes just inside plane 1 carry little mass if the plane cuts off only a small part of their cell.
Bonds across plane 2 that reach over a node line leave a residual. So of the planes near the wanted
place the pair is best whose plane 2 is farthest from node lines, among those that leave the right
share of a cell to the continuum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHARES = (0.05, 0.7)
"""Accepted shares of the cell that plane 1 cuts that lie in the continuum."""

THICKEST = 0.9
"""Largest distance of the planes, in cells, with one layer more than is necessary: with a thicker
zone between the planes waves are reflected more."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Planes:
    """Coordinates of plane 1 and plane 2 of a face (length), and where plane 2 lies in its cell.

    Attributes
    ----------
    first, second : float
    clear : float
        Distance of plane 2 from the nearest node line, in cells.
    """

    first: float
    second: float
    clear: float


def thickness(layer: float, cutoff: float) -> int:
    """Least number of layers between the planes.

    The free atoms next to plane 1 and the first atoms beyond plane 2 must not be neighbours:
    ``(t + 1) layer > cutoff``.
    """
    return max(int(np.floor(cutoff / layer * (1.0 + _ROUNDING))), 1)


def _counts(layer: float, cutoff: float, cell: float) -> list[int]:
    """Accepted numbers of layers between the planes."""
    least = thickness(layer, cutoff)
    return [least] + ([least + 1] if (least + 1) * layer <= THICKEST * cell else [])


def reach(layer: float, cutoff: float, cell: float) -> float:
    """Largest accepted distance of the planes (length)."""
    return _counts(layer, cutoff, cell)[-1] * layer


def pairs(
    wanted: float,
    outward: float,
    layer: float,
    offset: float,
    cutoff: float,
    cell: float,
    origin: float = 0.0,
) -> list[Planes]:
    """Find the planes that a face may have, the best ones first.

    There are none if no plane within half a cell of the wanted place has a share in the accepted
    range.

    Parameters
    ----------
    wanted : float
        Where plane 1 should be (length).
    outward : float
        1 if the continuum lies at larger coordinates, -1 if at smaller ones.
    layer, offset : float
        Distance of the layers of atoms, and the coordinate of one place midway between two.
    cutoff : float
        Range of the potential (length).
    cell, origin : float
        Edge of a cell, and the coordinate of a node line.
    """
    first = int(np.ceil((wanted - 0.5 * cell - offset) / layer - _ROUNDING))
    last = int(np.floor((wanted + 0.5 * cell - offset) / layer + _ROUNDING))
    ones = offset + layer * np.arange(first, last + 1)
    shares = _beyond(ones, outward, cell, origin)
    ones = ones[(shares > SHARES[0] - _ROUNDING) & (shares < SHARES[1] + _ROUNDING)]
    counts = _counts(layer, cutoff, cell)
    both = [(one, one + outward * count * layer) for one in ones for count in counts]
    off = [abs(_beyond(np.array(two), outward, cell, origin) - 0.5) for _, two in both]
    clear = np.round(0.5 - np.array(off), 9)
    return [Planes(*map(float, (*both[k], clear[k]))) for k in np.argsort(-clear, kind="stable")]


def _beyond(x: np.ndarray, outward: float, cell: float, origin: float) -> np.ndarray:
    """Share of the cell around coordinates that lies outward of them."""
    along = (x - origin) * outward / cell
    return np.asarray(1.0 - (along - np.floor(along + _ROUNDING)))
