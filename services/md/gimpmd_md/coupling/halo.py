"""Sums at the nodes that several patches share: ranks exchange their parts with neighbours."""

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

HALO_CELLS = 6.0
"""Distance from its patch (cells) up to which a rank holds complete nodal sums.

The projection needs this much (``projection.CORRECTION_CELLS``). An atom touches nodes up to 1.5
cells away, so it may be 4.5 cells outside the patch, because the body moves or because LAMMPS
places its boundaries between ranks differently.
"""


@dataclass(frozen=True)
class _Share:
    """The exchange with another rank: rows of the common nodes, and buffers for their sums."""

    rank: int
    rows: Ints
    sent: Floats
    received: Floats


class Halo:
    """The nodes that ranks share, which follow from the boxes of the patches.

    Every rank whose atoms may touch a node receives the parts of all other such ranks, and adds
    them in the order of the ranks. So all ranks hold the same bits, whatever the timing.

    Parameters
    ----------
    comm : mpi4py communicator
    grid : BackgroundGrid
    region : Box
        The MD region, cut into ``counts`` patches; rank r holds patch r.
    counts : tuple of int
    wanted : ndarray of int64, optional
        Ids of the canonical nodes whose sums are needed. By default these are all nodes.

    Attributes
    ----------
    patch : Box
    nodes : ndarray of int64
        Ids, ascending, of the wanted nodes within ``HALO_CELLS`` of the patch.
    """

    def __init__(
        self,
        comm: Any,
        grid: BackgroundGrid,
        region: Box,
        counts: tuple[int, ...],
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
            Gives the rows in the fields of the nodes with some ids.
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
        # persistent requests: MPI need not set up the same messages again in every step
        self._requests = [
            request
            for share in self._shares
            for request in (
                self._comm.Recv_init(share.received, source=share.rank),
                self._comm.Send_init(share.sent, dest=share.rank),
            )
        ]

    def complete(self, field: Floats) -> None:
        """Add the parts of other patches to nodal sums, in place; collective among neighbours."""
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


def own_patch(region: Box, counts: tuple[int, ...], comm: Any) -> Box:
    """Return the patch of this rank.

    Raises
    ------
    BackendError
        The number of ranks is not the number of patches.
    """
    boxes = patches(region, counts)
    if comm.size != len(boxes):
        layout = " x ".join(str(n) for n in counts)
        raise BackendError(
            f"started on {comm.size} MPI ranks, but md.patches cuts the region into {layout}; "
            f"start {len(boxes)} ranks"
        )
    return boxes[comm.rank]


def _near(grid: BackgroundGrid, box: Box) -> Bools:
    """Tell which canonical nodes are within ``HALO_CELLS`` of a box; shape ``(grid.size,)``."""
    reach = (HALO_CELLS + 1e-6) * grid.cell  # edges may fall on nodes
    x = grid.positions()
    near = grid.canonical()
    for axis, (low, high) in enumerate(box):
        away = x[:, axis] - 0.5 * (low + high)
        if grid.periodic[axis]:
            length = grid.cells[axis] * grid.cell
            away -= length * np.round(away / length)
        near &= np.abs(away) <= 0.5 * (high - low) + reach
    return near
