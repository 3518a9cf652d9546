"""Sums of nodes that patches share, completed among neighbours alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box, patches

REACH_CELLS = 6.0
"""Farthest node, in cells, of which a rank holds the whole sums, and that its atoms may touch.

The projection needs them (``projection.REACH_CELLS``). An atom touches nodes 1.5 cells away, which
leaves it 4.5 to drift: motion of the body, and of LAMMPS's own boundaries between ranks.
"""


@dataclass(frozen=True)
class _Share:
    """What is exchanged with another rank: rows of the common nodes, and buffers for them."""

    rank: int
    rows: Ints
    sent: Floats
    received: Floats


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
    wanted : ndarray of int64
        Ids of the canonical nodes that matter; None: all.

    Attributes
    ----------
    patch : Box
    nodes : ndarray of int64
        Ids, ascending, of the wanted nodes within ``REACH_CELLS`` of the patch.
    """

    def __init__(
        self,
        comm: Any,
        grid: BackgroundGrid,
        region: Box,
        counts: tuple[int, int],
        wanted: Ints | None = None,
    ) -> None:
        self._comm = comm
        self.patch = own_patch(region, counts, comm)
        held = _near(grid, self.patch)
        if wanted is not None:
            held &= np.isin(np.arange(grid.size), wanted)
        self.nodes = np.flatnonzero(held)
        self._common = {
            rank: np.flatnonzero(held & _near(grid, box))
            for rank, box in enumerate(patches(region, counts))
            if rank != comm.rank
        }

    def connect(self, places: Callable[[Ints], Ints], width: int) -> None:
        """Prepare the exchange of fields; collective among neighbours.

        Parameters
        ----------
        places : callable
            Gives the rows of nodes, by id, in the fields.
        width : int
            Number of columns of the fields.
        """
        self._shares = [
            _Share(rank, places(ids), np.empty((ids.size, width)), np.empty((ids.size, width)))
            for rank, ids in self._common.items()
            if ids.size
        ]
        self._shared = np.unique(np.concatenate([np.empty(0, np.int64), *self._rows()]))
        self._own = np.empty((self._shared.size, width))
        # set up once: a step has no time to find out anew who gets what
        self._requests = [
            request
            for share in self._shares
            for request in (
                self._comm.Recv_init(share.received, source=share.rank),
                self._comm.Send_init(share.sent, dest=share.rank),
            )
        ]

    def complete(self, field: Floats) -> None:
        """Add the other patches' parts of nodal sums, in place; collective among neighbours."""
        if not self._shares:
            return
        for share in self._shares:
            _take(field, share.rows, share.sent)
        for request in self._requests:
            request.Start()
        _take(field, self._shared, self._own)
        field[self._shared] = 0.0
        for request in self._requests:
            request.Wait()
        parts = [(share.rank, share.rows, share.received) for share in self._shares]
        for _, rows, part in sorted(
            [*parts, (self._comm.rank, self._shared, self._own)], key=_rank
        ):
            _add(field, rows, part)

    def _rows(self) -> list[Ints]:
        return [share.rows for share in self._shares]


def _rank(part: tuple[int, Ints, Floats]) -> int:
    return part[0]


@njit(cache=True)
def _take(field: Floats, rows: Ints, part: Floats) -> None:
    for k in range(rows.size):
        part[k] = field[rows[k]]


@njit(cache=True)
def _add(field: Floats, rows: Ints, part: Floats) -> None:
    for k in range(rows.size):
        field[rows[k]] += part[k]


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
    """Canonical nodes within reach of a box; shape ``(grid.size,)``."""
    reach = (REACH_CELLS + 1e-6) * grid.cell  # edges may fall on nodes
    x = grid.positions()
    near = grid.canonical()
    for axis, (low, high) in enumerate(box):
        away = x[:, axis] - 0.5 * (low + high)
        if grid.periodic[axis]:
            length = grid.cells[axis] * grid.cell
            away -= length * np.round(away / length)
        near &= np.abs(away) <= 0.5 * (high - low) + reach
    return near
