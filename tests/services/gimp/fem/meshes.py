"""Graded meshes of quadrilaterals around a box, as files that meshio writes."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import meshio
import numpy as np

Box = tuple[tuple[float, float], tuple[float, float]]
SIDES = ("left", "right", "bottom", "top")


def around(
    path: Path,
    outer: Box,
    inner: Box,
    cell: float,
    sides: tuple[str, ...] = SIDES,
    growth: float = 1.2,
    shake: float = 0.0,
    seed: int = 1,
) -> Path:
    """Write a mesh of the part of a box outside another, with a block at each of these sides.

    Along the inner box the elements are as long as cells; away from it they grow by a factor from
    layer to layer. Vertices inside the body are moved at random by up to ``shake`` of the thickness
    of the first layer.
    """
    places = [divmod(SIDES.index(side), 2) for side in sides]
    depths = [abs(outer[axis][upper] - inner[axis][upper]) for axis, upper in places]
    layers = 1
    while cell * (growth**layers - 1.0) / (growth - 1.0) < max(depths):
        layers += 1
    t = np.cumsum(growth ** np.arange(layers))
    t = np.concatenate([[0.0], t / t[-1]])[:, None, None]
    points, quads = [], []
    for (axis, upper), depth in zip(places, depths, strict=True):
        low, high = inner[1 - axis]
        n = round((high - low) / cell)
        along = np.linspace(0.0, 1.0, n + 1)
        edges = []
        for box in (inner, outer):
            edge = np.empty((n + 1, 2))
            start, end = box[1 - axis]
            edge[:, axis], edge[:, 1 - axis] = box[axis][upper], start + along * (end - start)
            edges.append(edge)
        block = (1.0 - t) * edges[0] + t * edges[1]
        if shake:
            size = depth * t[1, 0, 0]
            move = np.random.default_rng(seed).uniform(-shake, shake, block[1:-1, 1:-1].shape)
            block[1:-1, 1:-1] += size * move
        number = np.arange(block.size // 2).reshape(block.shape[:2]) + sum(map(len, points))
        corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        quads.append(np.stack([part.ravel() for part in corners], axis=1))
        points.append(block.reshape(-1, 2))
    x = np.concatenate(points)
    _, first, same = np.unique(x.round(6), axis=0, return_index=True, return_inverse=True)
    meshio.Mesh(np.pad(x[first], ((0, 0), (0, 1))), [("quad", same[np.concatenate(quads)])]).write(
        path
    )
    return path


def block(path: Path, cells: tuple[int, ...], kind: str, shake: float = 0.2) -> Path:
    """Write a mesh of unit cells, cut into elements of a kind, its inner vertices moved at random.

    A cell becomes two triangles, or six tetrahedra along one of its diagonals (Kuhn's).
    """
    x = np.stack(np.meshgrid(*map(np.arange, np.add(cells, 1)), indexing="ij"), axis=-1)
    number = np.arange(x[..., 0].size).reshape(x.shape[:-1])
    x = x.reshape(-1, len(cells)).astype(float)
    inner = ((x > 0.5) & (x < np.array(cells) - 0.5)).all(axis=1)
    x[inner] += np.random.default_rng(3).uniform(-shake, shake, x[inner].shape)

    def corner(*shift: int) -> np.ndarray:
        ends = zip(shift, cells, strict=True)
        return number[tuple(slice(s, s + n) for s, n in ends)].ravel()

    if kind in ("quad", "hexahedron"):
        square = [(0, 0), (1, 0), (1, 1), (0, 1)]
        levels = [()] if len(cells) == 2 else [(0,), (1,)]
        elements = [[corner(*shift, *level) for level in levels for shift in square]]
    else:
        elements = []
        for order in permutations(range(len(cells))):
            place = np.zeros(len(cells), dtype=int)
            path_of = [place.copy()]
            for axis in order:
                place[axis] = 1
                path_of.append(place.copy())
            elements.append([corner(*shift) for shift in path_of])
    quads = np.concatenate([np.stack(one, axis=1) for one in elements])
    meshio.Mesh(np.pad(x, ((0, 0), (0, 3 - len(cells)))), [(kind, quads)]).write(path)
    return path
