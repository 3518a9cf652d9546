"""The nodes of one rank: blocks of every level, one flat numbering, what ranks share.

Each box of each level is cut into patches, one for each rank. A patch with ``PAD`` nodes around
it is a *block*: a dense array of all nodes that the points of this rank may touch. Flat nodal
arrays hold the nodes of all blocks one after the other. Then follow parents of constrained nodes
that lie on other ranks, and the twins that carry the second velocity field across cracks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np

from gimpmd_gimp.grid.constraints import make_constraints
from gimpmd_gimp.grid.hierarchy import Hierarchy, IndexBox
from gimpmd_gimp.grid.slaves import Slaves, redirected
from gimpmd_gimp.sweeps.kernels import Frames, Stencils
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints

PAD = 3
"""Layers of nodes around a patch: one for the stencils, and two for points that drift."""


class Discontinuities(Protocol):
    """Surfaces across which the body is discontinuous: cracks (``fracture/cracks.py``)."""

    def doubled(self, level: int, x: Floats) -> Bools:
        """Which nodes of a level, at positions ``(n, d)``, get a twin."""
        ...

    def hidden(self, x: Floats, y: Floats) -> Bools:
        """Which positions ``x`` a surface separates from their partner in ``y``."""
        ...

    def cut_candidates(self, level: Int32s, x: Floats) -> Ints:
        """Points, by level and position on the grid, whose stencils a surface may cut."""
        ...

    def fill_detours(
        self, mesh: Mesh, reference: Floats, x: Floats, candidates: Ints, stencils: Stencils
    ) -> None:
        """List the nodes, twins included, of points whose stencils a surface cuts."""
        ...


@dataclass(frozen=True)
class Block:
    """The patch of a rank in a box of a level, with the nodes around it.

    Attributes
    ----------
    level : int
    patch : IndexBox
        Cells of the patch, from its first to its last node.
    first, shape : tuple of int
        First node of the block (``PAD`` before that of the patch) and nodes along each axis.
    offset : int
        Flat number of the first node.
    """

    level: int
    patch: IndexBox
    first: tuple[int, ...]
    shape: tuple[int, ...]
    offset: int

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape))


class Mesh:
    """Nodes of one rank.

    Parameters
    ----------
    hierarchy : Hierarchy
    comm : mpi4py communicator or None
        None for a program of one process.
    layout : tuple of int, optional
        Patches along each axis into which every box is cut. If left out, patches are as compact
        as possible.
    cracks : Discontinuities, optional
        Surfaces along which nodes get twins.
    slaves : Slaves, optional
        Nodes of the finest level that take the value of others.

    Attributes
    ----------
    blocks : list of Block
    frames : Frames
        The same, as sweeps read it.
    size : int
        Length of flat nodal arrays.
    level : ndarray of int64, shape ``(size,)``
    coords : ndarray of int64, shape ``(size, d)``
    basis : ndarray of bool, shape ``(size,)``
        Nodes of the composite basis, each once. The others are constrained or not in use.
    counts : ndarray, shape ``(size,)``
        1 for nodes of the basis, and for slaves, that this rank counts; 0 for those that another
        rank counts.
    twin : ndarray of int64, shape ``(size,)``
        A node's twin, or -1.
    constraints : Constraints
        Nodes that take their value from others.
    shared : dict
        For each neighbouring rank, the nodes that both hold, in the same order on both.
    """

    def __init__(
        self,
        hierarchy: Hierarchy,
        comm: Any = None,
        layout: tuple[int, ...] | None = None,
        cracks: Discontinuities | None = None,
        slaves: Slaves | None = None,
    ) -> None:
        self.hierarchy, self.comm = hierarchy, comm
        self.rank: int = comm.rank if comm is not None else 0
        self.ranks: int = comm.size if comm is not None else 1
        self.patches = [
            [cut(box, self.ranks, layout) for box in hierarchy.boxes(level)]
            for level in range(hierarchy.top + 1)
        ]
        self.blocks = self._make_blocks()
        self.frames = self._make_frames()
        self._number(cracks, slaves)
        self._share()

    def positions(self) -> Floats:
        """Positions of all nodes, shape ``(size, d)``."""
        return self.hierarchy.position(self.level, self.coords)

    def find(self, level: int, coords: Ints) -> Ints:
        """Flat numbers of nodes of the basis and of slaves; -1 where this rank does not hold one.

        Parameters
        ----------
        coords : ndarray of int64, shape ``(n, d)``
        """
        coords = self.hierarchy.wrap(level, coords)
        keys = self._keys(np.full(coords.shape[0], level), coords)
        found = self._lookup(keys)
        if self._slaves:
            slave = [self._slaves.get(key, -1) for key in keys.tolist()]
            found = np.where(found < 0, slave, found)
        return found

    def largest(self, value: float) -> float:
        """Largest of a number over all ranks; collective."""
        if self.ranks == 1:
            return value
        return float(max(self.comm.allgather(value)))

    def _make_blocks(self) -> list[Block]:
        blocks, offset = [], 0
        for level, boxes in enumerate(self.patches):
            for pieces in boxes:
                if self.rank < len(pieces):
                    patch = pieces[self.rank]
                    first = tuple(low - PAD for low, _ in patch)
                    shape = tuple(high - low + 1 + 2 * PAD for low, high in patch)
                    blocks.append(Block(level, patch, first, shape, offset))
                    offset += blocks[-1].size
        return blocks

    def _make_frames(self) -> Frames:
        h, d = self.hierarchy, self.hierarchy.dim
        edges = np.array([h.edge(block.level) for block in self.blocks])
        first = np.array([block.first for block in self.blocks]).reshape(-1, d)
        shape = np.array([block.shape for block in self.blocks], dtype=np.int64).reshape(-1, d)
        middle = 0.5 * (shape - 1).astype(np.float64)
        strides = np.ones_like(shape)
        for axis in range(d - 2, -1, -1):
            strides[:, axis] = strides[:, axis + 1] * shape[:, axis + 1]
        return Frames(
            centre=np.asarray(h.low) + (first + middle) * edges[:, None],
            middle=middle,
            per_cell=1.0 / edges,
            shape=shape,
            strides=strides,
            offset=np.array([block.offset for block in self.blocks], dtype=np.int64),
            period=h.period,
        )

    def _number(self, cracks: Discontinuities | None, slaves: Slaves | None) -> None:
        """Number the nodes; find which belong to the basis and the parents of the others."""
        h = self.hierarchy
        levels, nodes, alive = [], [], []
        for block in self.blocks:
            axes = [f + np.arange(n) for f, n in zip(block.first, block.shape, strict=True)]
            coords = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, h.dim)
            levels.append(np.full(block.size, block.level))
            nodes.append(coords)
            wrapped = h.wrap(block.level, coords)
            deep = (  # so deep inside a finer level that no coarse point can touch it
                h.inside(block.level + 1, 2 * wrapped, shrink=2 * PAD)
                if block.level < h.top
                else np.zeros(block.size, dtype=np.bool_)
            )
            alive.append(~deep)
        level = np.concatenate([np.empty(0, np.int64), *levels]).astype(np.int64)
        coords = np.concatenate([np.empty((0, h.dim), np.int64), *nodes])
        live = np.flatnonzero(np.concatenate([np.empty(0, np.bool_), *alive]))

        row, parent_level, parent_coords, weight = h.parents(level[live], coords[live])
        if slaves is not None:
            row, parent_level, parent_coords, weight = redirected(
                slaves, h.top, row, parent_level, parent_coords, weight
            )
        row = live[row]
        key = self._keys(parent_level, parent_coords)
        itself = (level[row] == parent_level) & (
            _same_node(h, level[row], coords[row], parent_coords)
        )
        self._names, place = np.unique(key[itself], return_index=True)
        self._places = row[itself][place]  # the first of several images is the node itself
        missing = np.setdiff1d(key, self._names)
        _, where = np.unique(key, return_index=True)
        extra = where[np.isin(key[where], missing)]
        self._extend(key[extra], level.size + np.arange(extra.size))
        level = np.concatenate([level, parent_level[extra]])
        coords = np.concatenate([coords, parent_coords[extra]])

        parent = self._lookup(key)
        dependent = parent != row
        self.basis = np.zeros(level.size, dtype=np.bool_)
        self.basis[self._places] = True
        self.level, self.coords = level, coords
        self._slaves = self._find_slaves(slaves, live)
        self.twin = np.full(level.size, -1, dtype=np.int64)
        constraints = (row[dependent], parent[dependent], weight[dependent])
        if cracks is not None:
            constraints = self._double(cracks, *constraints)
        self.size = self.level.size
        self.constraints = make_constraints(*constraints)

    def _find_slaves(self, slaves: Slaves | None, live: Ints) -> dict[int, int]:
        """Flat numbers of the slaves of this rank, by their keys."""
        if slaves is None:
            return {}
        h = self.hierarchy
        finest = live[self.level[live] == h.top]
        keys = self._keys(np.full(finest.size, h.top), h.wrap(h.top, self.coords[finest]))
        wanted = self._keys(np.full(len(slaves.node), h.top), slaves.node)
        chosen = np.isin(keys, wanted)
        found, first = np.unique(keys[chosen], return_index=True)
        return dict(zip(found.tolist(), finest[chosen][first].tolist(), strict=True))

    def _double(
        self, cracks: Discontinuities, constrained: Ints, parent: Ints, weight: Floats
    ) -> tuple[Ints, Ints, Floats]:
        """Append twins of the nodes near cracks; return the constraints with those of the twins."""
        near = np.zeros(self.level.size, dtype=np.bool_)
        dependent = np.zeros(self.level.size, dtype=np.bool_)
        dependent[constrained] = True
        for level in range(self.hierarchy.top + 1):
            here = np.flatnonzero((self.level == level) & (self.basis | dependent))
            coords = self.hierarchy.wrap(level, self.coords[here])
            near[here] = cracks.doubled(level, self.hierarchy.position(self.level[here], coords))
        chosen = np.flatnonzero(near)
        x = self.positions()
        self.twin[chosen] = self.level.size + np.arange(chosen.size)
        named = chosen[self.basis[chosen]]
        self._extend(
            self._keys(self.level[named], self.coords[named]) + self._twin_shift, self.twin[named]
        )
        self.level = np.concatenate([self.level, self.level[chosen]])
        self.coords = np.concatenate([self.coords, self.coords[chosen]])
        self.basis = np.concatenate([self.basis, self.basis[chosen]])
        self.twin = np.concatenate([self.twin, np.full(chosen.size, -1, dtype=np.int64)])

        other = np.where(self.twin[parent] >= 0, self.twin[parent], parent)
        hidden = cracks.hidden(x[constrained], x[parent])
        seen, unseen = np.where(hidden, other, parent), np.where(hidden, parent, other)
        both = self.twin[constrained] >= 0
        return (
            np.concatenate([constrained, self.twin[constrained[both]]]),
            np.concatenate([seen, unseen[both]]),
            np.concatenate([weight, weight[both]]),
        )

    def _share(self) -> None:
        """Find the nodes that other ranks hold as well."""
        self.counts = self.basis.astype(np.float64)
        self.counts[list(self._slaves.values())] = 1.0
        self.shared: dict[int, Ints] = {}
        if self.ranks == 1:
            return
        for rank, (names, slaves) in enumerate(
            self.comm.allgather((self._names, list(self._slaves)))
        ):
            if rank == self.rank:
                continue
            if rank < self.rank:
                others = [self._slaves[key] for key in slaves if key in self._slaves]
                self.counts[others] = 0.0
            common = np.intersect1d(self._names, names, assume_unique=True)
            if common.size:
                self.shared[rank] = self._lookup(common)
                if rank < self.rank:
                    self.counts[self.shared[rank]] = 0.0

    # --- names of nodes ---------------------------------------------------------------------

    def _keys(self, level: Ints, coords: Ints) -> Ints:
        """One integer for each node of the basis, the same on all ranks."""
        h = self.hierarchy
        extent = h.count(h.top) + 4 * PAD + 1
        key = np.asarray(level, dtype=np.int64).copy()
        for axis in range(h.dim):
            key = key * extent[axis] + coords[:, axis] + 2 * PAD
        return key

    @property
    def _twin_shift(self) -> int:
        h = self.hierarchy
        return int((h.top + 1) * np.prod(h.count(h.top) + 4 * PAD + 1))

    def _lookup(self, keys: Ints) -> Ints:
        if self._names.size == 0:
            return np.full(keys.size, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(self._names, keys), self._names.size - 1)
        return np.where(self._names[at] == keys, self._places[at], -1)

    def _extend(self, names: Ints, places: Ints) -> None:
        names = np.concatenate([self._names, names])
        order = np.argsort(names)
        self._names = names[order]
        self._places = np.concatenate([self._places, places])[order].astype(np.int64)


def _same_node(h: Hierarchy, level: Ints, coords: Ints, other: Ints) -> Bools:
    """Which nodes are the same up to periodic images."""
    same = np.zeros(level.size, dtype=np.bool_)
    for value in np.unique(level):
        here = level == value
        same[here] = (h.wrap(int(value), coords[here]) == other[here]).all(axis=1)
    return same


def cut(box: IndexBox, ranks: int, layout: tuple[int, ...] | None = None) -> list[IndexBox]:
    """Cut a box into at most one patch for each rank, as compact as possible.

    Parameters
    ----------
    layout : tuple of int, optional
        Patches along each axis, instead of the most compact ones.

    Returns
    -------
    list of IndexBox
        Patch r belongs to rank r. A small box may have fewer patches than there are ranks.
    """
    n = [high - low for low, high in box]
    for pieces in range(ranks, 0, -1):
        fitting = [
            counts
            for counts in ([layout] if layout and pieces == ranks else _factors(pieces, len(n)))
            if all(length >= 2 * count for length, count in zip(n, counts, strict=True))
        ]
        if fitting:
            best = min(fitting, key=lambda counts: (_surface(n, counts), counts))
            edges = [
                low + (np.arange(count + 1) * length) // count
                for (low, _), length, count in zip(box, n, best, strict=True)
            ]
            ends = [list(zip(e[:-1].tolist(), e[1:].tolist(), strict=True)) for e in edges]
            return [tuple(piece) for piece in product(*ends)]
    return [box]


def _factors(number: int, dim: int) -> Iterable[tuple[int, ...]]:
    if dim == 1:
        yield (number,)
        return
    for first in range(1, number + 1):
        if number % first == 0:
            for rest in _factors(number // first, dim - 1):
                yield (first, *rest)


def _surface(n: list[int], counts: tuple[int, ...]) -> float:
    """Number of cells along the faces between patches."""
    volume = float(np.prod(n))
    return sum(volume / length * (count - 1) for length, count in zip(n, counts, strict=True))
