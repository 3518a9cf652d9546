"""Sums of nodes that patches share, completed among neighbours alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import BackgroundGrid, Bools, Floats, Ints
from gimpmd_schemas.zones import Box, patches

MARGIN_CELLS = 3.0
"""How far, in cells, an atom may lie outside its patch: drift of the body and of LAMMPS's grid."""

STENCIL_CELLS = 1.5
"""Farthest node that an atom touches, in cells."""


class Halo:
    """Who shares which nodes, fixed at the start from the boxes of the patches.

    Every rank that can touch a node receives the parts of all others that can, and adds them in
    the order of ranks: all hold the same bits, whatever the timing.

    Parameters
    ----------
    comm : mpi4py communicator
    grid : BackgroundGrid
    region : Box
        The MD region, cut into ``counts`` patches; rank r holds patch r.
    counts : tuple of int

    Attributes
    ----------
    patch : Box
    nodes : ndarray of int64
        Ids, ascending, of the canonical nodes that atoms of this rank may touch; the margin is
        ``MARGIN_CELLS``.
    """

    def __init__(
        self, comm: Any, grid: BackgroundGrid, region: Box, counts: tuple[int, int]
    ) -> None:
        self._comm = comm
        self.patch = own_patch(region, counts, comm)
        boxes = patches(region, counts)
        touched = _near(grid, self.patch)
        self.nodes = np.flatnonzero(touched)
        self._parts: dict[int, Ints] = {}
        for rank, box in enumerate(boxes):
            shared = np.flatnonzero((touched & _near(grid, box))[self.nodes])
            if rank != comm.rank and shared.size:
                self._parts[rank] = shared
        self._shared = np.unique(np.concatenate([np.empty(0, np.int64), *self._parts.values()]))

    def complete(self, field: Floats) -> None:
        """Add the other patches' parts of nodal sums, in place; collective among neighbours.

        Parameters
        ----------
        field : ndarray, shape ``(nodes.size, k)``
        """
        received = {rank: np.empty((ids.size, field.shape[1])) for rank, ids in self._parts.items()}
        requests = [self._comm.Irecv(part, source=rank) for rank, part in received.items()]
        sent = [field[ids] for ids in self._parts.values()]
        requests += [
            self._comm.Isend(part, dest=rank) for rank, part in zip(self._parts, sent, strict=True)
        ]
        own = field[self._shared]
        field[self._shared] = 0.0
        for request in requests:
            request.Wait()
        for rank in sorted([*received, self._comm.rank]):
            if rank == self._comm.rank:
                field[self._shared] += own
            else:
                field[self._parts[rank]] += received[rank]


def own_patch(region: Box, counts: tuple[int, int], comm: Any) -> Box:
    """The patch of this rank.

    Raises
    ------
    BackendError
        There are not as many ranks as patches.
    """
    boxes = patches(region, counts)
    if comm.size != len(boxes):
        raise BackendError(
            f"started on {comm.size} MPI ranks, but md.patches cuts the region into {counts[0]} x "
            f"{counts[1]}; start {len(boxes)} ranks"
        )
    return boxes[comm.rank]


def _near(grid: BackgroundGrid, box: Box) -> Bools:
    """Canonical nodes that atoms of a box, with the margin, may touch; shape ``(grid.size,)``."""
    reach = (MARGIN_CELLS + STENCIL_CELLS) * grid.cell
    x = grid.positions()
    near = grid.canonical()
    for axis, (low, high) in enumerate(box):
        away = x[:, axis] - 0.5 * (low + high)
        if grid.periodic[axis]:
            length = grid.cells[axis] * grid.cell
            away -= length * np.round(away / length)
        near &= np.abs(away) <= 0.5 * (high - low) + reach
    return near
