"""Nodes at the planes that have next to no continuum follow other nodes.

A node inside plane 1 whose hat reaches only a little into the continuum carries almost no mass, and
moves few ghosts or none. As a freedom of its own it makes modes of negative stiffness. It takes
instead the value that its neighbours outside extrapolate to its place: ``U = T U``, and forces,
momenta and masses go to the others by the transpose. So does a node beyond a face of the body: the
ghosts next to the face move with it too, because their weights are averaged over a period.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.shells import Shells, body_of, inside
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box

LEAST_SHARE = 0.27
"""Share of its hat that a node inside plane 1 needs in the continuum to be a freedom."""

REACH = 4
"""Cells from a slave in which the cell that it follows is looked for."""

_ROUNDING = 1e-9


def share_of(node: Floats, boxes: Sequence[Box], cell: float, body: Box) -> float:
    """Share of the hat of a node that lies in the continuum.

    It is the largest, over all boxes in the support of the hat without free atoms, of the least,
    over the axes, of the integral of the hat along the axis over its integral without planes. With
    one box of atoms this is the largest share along one of the axes.

    Parameters
    ----------
    node : ndarray, shape ``(d,)``
    boxes : sequence of Box
        Boxes of free atoms.
    cell : float
        Edge of a cell.
    body : Box
        There is no continuum beyond it.
    """
    ends_of_body = (np.array(body) - node[:, None]) / cell
    low, high = np.clip(ends_of_body.T, -1.0, 1.0)
    if (high <= low).any():
        return 0.0
    local = (np.array(boxes) - node[None, :, None]) / cell
    near = local[((local[:, :, 0] < 1.0) & (local[:, :, 1] > -1.0)).all(axis=1)]
    spans = []
    for axis in range(len(node)):
        bounds = low[axis], high[axis]
        ends = np.unique(np.clip(np.concatenate([bounds, near[:, axis].ravel()]), *bounds))
        spans.append([(a, b) for k, a in enumerate(ends) for b in ends[k + 1 :]])
    best = 0.0
    for span in product(*spans):
        start, end = np.array(span).T
        filled = (near[:, :, 0] < end - _ROUNDING) & (near[:, :, 1] > start + _ROUNDING)
        if not filled.all(axis=1).any():
            best = max(best, float((_integral(end) - _integral(start)).min()))
    return best


def _integral(x: Floats) -> Floats:
    """Integral of ``1 - |x|`` from -1 to x; 1 at the end."""
    return np.where(x < 0.0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2)


def find_slaves(grid: BackgroundGrid, shells: Shells, touched: Bools) -> Ints:
    """Ids of the nodes that follow others.

    Parameters
    ----------
    touched : ndarray of bool, shape ``(grid.size,)``
        Nodes that move a ghost or a piece of the continuum.
    """
    x, body = grid.positions(), body_of(grid)
    slack = _ROUNDING * grid.cell
    beyond = (x < np.array(body)[:, 0] - slack) | (x > np.array(body)[:, 1] + slack)
    candidates = np.flatnonzero(touched & (inside(shells.free, x) | beyond.any(axis=1)))
    shares = [share_of(x[node], shells.free, grid.cell, body) for node in candidates]
    return candidates[np.array(shares) < LEAST_SHARE].astype(np.int64)


def constraints(grid: BackgroundGrid, slaves: Ints, in_continuum: Bools) -> Sparse:
    """The matrix T that gives all nodes their values from those that are freedoms.

    A slave takes the linear function, in each axis, of the nearest cell all of whose nodes touch
    the continuum and are freedoms; of cells at equal distance the mean.

    Parameters
    ----------
    slaves : ndarray of int64
        Ids of the slaves.
    in_continuum : ndarray of bool, shape ``(grid.size,)``
        Nodes whose hats reach into the continuum.

    Returns
    -------
    sparse matrix, shape ``(grid.size, grid.size)``
        Identity for nodes that are no slaves; the columns of slaves are zero.

    Raises
    ------
    BackendError
        There is no such cell near a slave.
    """
    usable = in_continuum.copy()
    usable[slaves] = False
    free = np.ones(grid.size)
    free[slaves] = 0.0
    rows, columns, values = [], [], []
    shape, dim = np.array(grid.shape), grid.dim
    corners = np.array(list(product((0, 1), repeat=dim)))
    starts = np.array(list(product(range(-REACH, REACH), repeat=dim)))
    gap = np.maximum(np.maximum(starts, -1 - starts), 0)  # of a cell from the slave, in cells
    distance = (gap**2).sum(axis=1)
    order = np.argsort(distance, kind="stable")
    starts, distance = starts[order], distance[order]
    images = grid.images()
    for slave in slaves:
        at = np.array(np.unravel_index(slave, grid.shape))
        nodes = at + starts[:, None] + corners
        on_grid = ((nodes >= 0) & (nodes < shape)).all(axis=(1, 2))
        ids = images[
            np.ravel_multi_index(tuple(np.moveaxis(nodes, -1, 0)), grid.shape, mode="clip")
        ]
        good = on_grid & usable[ids].all(axis=1)
        if not good.any():
            place = ", ".join(f"{c:g}" for c in grid.positions()[slave])
            raise BackendError(
                f"the node at ({place}) has almost no continuum, and no cell of the continuum near "
                "it: the gap between two regions of atoms is too narrow; move them apart, or use "
                "smaller cells"
            )
        nearest = np.flatnonzero(good & (distance == distance[good].min()))
        for number in nearest:
            right = -starts[number]  # coordinates of the slave in the cell
            weight = np.where(corners == 1, right, 1 - right).prod(axis=1) / nearest.size
            rows += [slave] * len(corners)
            columns += ids[number].tolist()
            values += weight.tolist()
    links = sparse.coo_array((values, (rows, columns)), shape=(grid.size, grid.size))
    return (sparse.diags_array(free) + links).tocsr()
