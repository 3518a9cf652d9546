"""Sums at the nodes that several ranks share, wherever their atoms are.

A rank always holds the nodes near its own patch of the MD region. What it exchanges with the
coupler belongs to these nodes, so it never changes. But atoms move from rank to rank as the body
slides, turns or flies. A rank whose atoms touch other nodes holds these nodes too, and the ranks
pass sums and values on to each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.zones import Box, owners, patches

HALO_CELLS = 6.0
"""Distance from its patch (cells) up to which a rank always holds complete nodal sums.

The projection needs this much (``projection.CORRECTION_CELLS``). An atom touches nodes up to 1.5
cells away. So ranks need no other nodes until an atom is 4.5 cells outside the patch.
"""

SURROUND_CELLS = 4
"""How many nodes around an atom, along every axis, a rank holds once its atoms have moved far.

An atom touches nodes up to two away from the nearest one. The others spare the ranks a new
agreement for every atom that arrives.
"""


class Halo:
    """The nodes that a rank holds, and those that it shares with each other rank.

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
    comm : mpi4py communicator
    home : ndarray of int64
        Ids, ascending, of the wanted nodes within ``HALO_CELLS`` of the patch.
    own : ndarray of int64
        Those of them that belong to this rank and no other: the patch holds them, or is nearest.
    nodes : ndarray of int64
        Ids, ascending, of the nodes that the rank holds: ``home`` and, after `surround`, the wanted
        nodes around its atoms.
    common : dict
        Ids of the nodes that another rank holds too, by rank.
    """

    def __init__(
        self,
        comm: Any,
        grid: BackgroundGrid,
        region: Box,
        counts: tuple[int, ...],
        wanted: Ints | None = None,
    ) -> None:
        self.comm, self._grid = comm, grid
        self._wanted = grid.canonical()
        if wanted is not None:
            self._wanted &= np.isin(np.arange(grid.size), wanted)
        homes = [np.flatnonzero(_near(grid, box) & self._wanted) for box in patches(region, counts)]
        self.home = homes[comm.rank]
        owner = owners(region, counts, grid.positions()[self.home])
        self.own = self.home[owner == comm.rank]
        self._away = False  # whether any rank holds more than its home
        self._outward: Exchange | None = None
        self._hold(homes)

    def _hold(self, nodes: list[Ints]) -> None:
        """Set the nodes that each rank holds."""
        rank = self.comm.rank
        self.nodes = nodes[rank]
        self.common = {
            other: np.intersect1d(self.nodes, ids, assume_unique=True)
            for other, ids in enumerate(nodes)
            if other != rank
        }

    def surround(self, x: Floats) -> None:
        """Hold the home nodes and those around positions ``x``, shape ``(n, d)``; collective.

        Exchanges made before must be made anew.
        """
        around = np.flatnonzero(_around(self._grid, x) & self._wanted)
        held = self.comm.allgather((np.union1d(self.home, around), self.home.size))
        self._away = any(nodes.size > home for nodes, home in held)
        self._hold([nodes for nodes, _ in held])
        if self._outward is not None:
            self._outward.free()
            self._outward = None

    def rows(self, nodes: Ints) -> Ints:
        """Places in `nodes` of nodes with these ids, which the rank must hold."""
        return np.searchsorted(self.nodes, nodes).astype(np.int64)

    def distribute(self, values: Floats) -> Floats:
        """Values on `nodes` from those on `home`, both of shape ``(nodes, k)``; collective.

        Ranks that hold nodes far from their patches get the values from the owners.
        """
        if not self._away:
            return values
        if self._outward is None:
            self._outward = Exchange(self, self.rows, values.shape[1])
        field = np.zeros((self.nodes.size, values.shape[1]))
        field[self.rows(self.own)] = values[np.searchsorted(self.home, self.own)]
        self._outward.complete(field)
        return field


@dataclass(frozen=True)
class _Share:
    """The exchange with another rank: rows of the common nodes, and buffers for their sums."""

    rank: int
    rows: Ints
    sent: Floats
    received: Floats


class Exchange:
    """Completes the sums of fields over the nodes that ranks share.

    Every rank that holds a node receives the parts of all other such ranks, and adds them in the
    order of the ranks. So all ranks have the same bits, whatever the timing, and whichever ranks
    hold the node without adding to it.

    Parameters
    ----------
    halo : Halo
    places : callable
        Gives the rows in the fields of the nodes with some ids.
    width : int
        Number of columns of the fields.
    """

    def __init__(self, halo: Halo, places: Callable[[Ints], Ints], width: int) -> None:
        self._rank = halo.comm.rank
        self._shares = [
            _Share(rank, places(ids), np.empty((ids.size, width)), np.empty((ids.size, width)))
            for rank, ids in halo.common.items()
            if ids.size
        ]
        rows = [share.rows for share in self._shares]
        self._shared = np.unique(np.concatenate([np.empty(0, np.int64), *rows]))
        self._own = np.empty((self._shared.size, width))
        # persistent requests: MPI need not set up the same messages again in every step
        self._requests = [
            request
            for share in self._shares
            for request in (
                halo.comm.Recv_init(share.received, source=share.rank),
                halo.comm.Send_init(share.sent, dest=share.rank),
            )
        ]

    def complete(self, field: Floats) -> None:
        """Add the parts of other ranks to nodal sums, in place; collective among these ranks."""
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
        for _, rows, part in sorted([*parts, (self._rank, self._shared, self._own)], key=_rank):
            _add(field, rows, part)

    def free(self) -> None:
        """Give MPI's requests back; the exchange is of no use afterwards."""
        for request in self._requests:
            request.Free()


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
    """Tell which nodes are within ``HALO_CELLS`` of a box; shape ``(grid.size,)``."""
    reach = (HALO_CELLS + 1e-6) * grid.cell  # edges may fall on nodes
    x = grid.positions()
    near = np.ones(grid.size, dtype=np.bool_)
    for axis, (low, high) in enumerate(box):
        away = x[:, axis] - 0.5 * (low + high)
        if grid.periodic[axis]:
            length = grid.cells[axis] * grid.cell
            away -= length * np.round(away / length)
        near &= np.abs(away) <= 0.5 * (high - low) + reach
    return near


def _around(grid: BackgroundGrid, x: Floats) -> Bools:
    """Tell which canonical nodes are near positions ``x``; shape ``(grid.size,)``.

    They are at most ``SURROUND_CELLS`` along every axis from the node nearest to a position.
    Positions beyond the padded grid have none.
    """
    node = np.rint((x - np.array(grid.origin)) / grid.cell)
    repeats, cells = np.array(grid.periodic), np.array(grid.cells)
    node = np.where(repeats, node % cells, node)
    inside = ((node >= -PAD) & (node <= cells + PAD)).all(axis=1)  # not so for NaN
    near = np.zeros(grid.shape, dtype=np.bool_)
    near[tuple(node[inside].astype(np.int64).T + PAD)] = True
    canonical = tuple(
        slice(PAD, PAD + n) if periodic else slice(None)
        for n, periodic in zip(grid.cells, grid.periodic, strict=True)
    )
    ends = ["wrap" if periodic else "constant" for periodic in grid.periodic]
    near[canonical] = maximum_filter(near[canonical], size=2 * SURROUND_CELLS + 1, mode=ends)
    return near.ravel()
