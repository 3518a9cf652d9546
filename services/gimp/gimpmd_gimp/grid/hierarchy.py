"""Nested levels of the background grid: geometry that all ranks share.

Level 0 covers the domain. Each finer level has half the cell and covers boxes inside the coarser
level. The name of a node is its level and its integer coordinates on the lattice of the level,
which starts at the lower corner of the domain.

One composite basis spans all levels. A node strictly inside the boxes of a finer level is not in
the basis, and a finer node on or outside the rim of its boxes takes the interpolated value of the
coarser level. Every level can then be swept as a uniform grid, and all levels represent one
continuous field, as with the hanging nodes of adaptive finite elements. The weights of points are
those of the composite hat functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.checks.levels import MARGIN

IndexBox = tuple[tuple[int, int], ...]
"""First and last node of a box along each axis, on the lattice of its level."""


@dataclass(frozen=True)
class Hierarchy:
    """Levels of the background grid.

    Parameters
    ----------
    low : tuple of float
        Lower corner of the domain (length).
    cell : float
        Edge of a cell of level 0.
    cells : tuple of int
        Cells of level 0 along each axis.
    periodic : tuple of bool
    finer : tuple
        For level 1, 2, ... the boxes of that level, on its own lattice.

    Raises
    ------
    ValueError
        A box ends between node lines of the coarser level, or closer than ``MARGIN`` coarser
        cells to the rim of that level or to another box of its own level.
    """

    low: tuple[float, ...]
    cell: float
    cells: tuple[int, ...]
    periodic: tuple[bool, ...]
    finer: tuple[tuple[IndexBox, ...], ...] = ()

    def __post_init__(self) -> None:
        for level in range(1, self.top + 1):
            for box in self.boxes(level):
                if any(end % 2 for pair in box for end in pair):
                    raise ValueError(
                        f"box {box} of level {level} ends between node lines of level {level - 1}"
                    )
                if not any(self._is_nested(level, box, b) for b in self.boxes(level - 1)):
                    raise ValueError(
                        f"box {box} of level {level} does not lie inside a box of level "
                        f"{level - 1} with {MARGIN} of that level's cells around it"
                    )
            for a, b in combinations(self.boxes(level), 2):
                gap = max(max(q[0] - p[1], p[0] - q[1]) for p, q in zip(a, b, strict=True))
                if gap < 2 * MARGIN:
                    raise ValueError(
                        f"boxes {a} and {b} of level {level} overlap or come closer than "
                        f"{MARGIN} cells of level {level - 1}"
                    )

    def _is_nested(self, level: int, box: IndexBox, parent: IndexBox) -> bool:
        """Whether a box lies in a coarser one with the margin, except where both end the domain."""
        for axis, (low, high) in enumerate(box):
            start, end = (2 * x for x in parent[axis])
            at_end = [low == start == 0, high == end == self.count(level)[axis]]
            if self.periodic[axis]:
                at_end = [all(at_end)] * 2
            gaps = (low - start, end - high)
            if any(g < 2 * MARGIN and not e for g, e in zip(gaps, at_end, strict=True)):
                return False
        return True

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return len(self.cells)

    @property
    def top(self) -> int:
        """The finest level."""
        return len(self.finer)

    @cached_property
    def period(self) -> Floats:
        """Length after which the domain repeats along each axis, 0 where it does not."""
        return np.array(self.cells) * self.cell * np.array(self.periodic)

    def edge(self, level: int) -> float:
        """Edge of a cell."""
        return self.cell / 2**level

    def count(self, level: int) -> Ints:
        """Cells along each axis if the whole domain had this level."""
        return np.array(self.cells, dtype=np.int64) * 2**level

    def boxes(self, level: int) -> tuple[IndexBox, ...]:
        """Boxes of the level."""
        if level == 0:
            return (tuple((0, int(n)) for n in self.cells),)
        return self.finer[level - 1]

    def position(self, level: Ints, coords: Ints) -> Floats:
        """Positions of nodes, shape ``(n, d)``."""
        return np.asarray(self.low) + coords * (self.cell / 2.0**level)[:, None]

    def wrap(self, level: int, coords: Ints) -> Ints:
        """Coordinates of nodes moved by whole periods into the domain."""
        wrapped = coords.copy()
        for axis, repeats in enumerate(self.periodic):
            if repeats:
                wrapped[:, axis] %= self.count(level)[axis]
        return wrapped

    def inside(self, level: int, coords: Ints, shrink: int = 0) -> Bools:
        """Which nodes lie strictly inside the boxes of a level, shrunk by ``shrink`` cells.

        A box has no rim where it ends on a face of the domain, or spans a periodic axis.
        """
        found = np.zeros(coords.shape[0], dtype=np.bool_)
        for box in self.boxes(level):
            strictly = np.ones(coords.shape[0], dtype=np.bool_)
            for axis, (low, high) in enumerate(self._open(level, box)):
                strictly &= coords[:, axis] > low + shrink
                strictly &= coords[:, axis] < high - shrink
            found |= strictly
        return found

    def distance(self, level: int, x: Floats) -> Floats:
        """Distance of positions outside the boxes of a level (length); negative inside.

        It is the largest of the distances along the axes.
        """
        away = np.full(x.shape[0], np.inf)
        for box in self.boxes(level):
            worst = np.full(x.shape[0], -np.inf)
            for axis, (low, high) in enumerate(self._open(level, box)):
                y = (x[:, axis] - self.low[axis]) / self.edge(level)
                if self.periodic[axis] and np.isfinite(low):
                    n = self.count(level)[axis]
                    y -= n * np.round((y - 0.5 * (low + high)) / n)
                worst = np.maximum(worst, np.maximum(low - y, y - high))
            away = np.minimum(away, worst)
        return away * self.edge(level)

    def _open(self, level: int, box: IndexBox) -> list[tuple[float, float]]:
        ends = []
        for axis, (low, high) in enumerate(box):
            n = int(self.count(level)[axis])
            if self.periodic[axis]:
                spans = high - low == n
                ends.append((-np.inf, np.inf) if spans else (float(low), float(high)))
            else:
                ends.append((-np.inf if low == 0 else low, np.inf if high == n else high))
        return ends

    def parents(self, level: Ints, coords: Ints) -> tuple[Ints, Ints, Ints, Floats]:
        """Express nodes by nodes of the composite basis.

        Parameters
        ----------
        level : ndarray of int64, shape ``(n,)``
        coords : ndarray of int64, shape ``(n, d)``

        Returns
        -------
        row : ndarray of int64, shape ``(m,)``
            Which of the given nodes each entry belongs to, ascending.
        level, coords : ndarray of int64
            Nodes of the basis, shapes ``(m,)`` and ``(m, d)``.
        weight : ndarray, shape ``(m,)``
        """
        row = np.arange(level.size)
        weight = np.ones(level.size)
        for _ in range(2 * self.top + 2):
            entries = []
            for value in np.unique(level):
                here = level == value
                entries.append(self._one_down(int(value), row[here], coords[here], weight[here]))
            if not entries:  # no nodes at all: a patch may need none of its neighbours
                break
            before = level.size
            row, level, coords, weight = (
                np.concatenate(parts) for parts in zip(*entries, strict=True)
            )
            if level.size == before and self._all_basis(level, coords):
                break
        order = np.argsort(row, kind="stable")
        return row[order], level[order], coords[order], weight[order]

    def _all_basis(self, level: Ints, coords: Ints) -> bool:
        return all(
            self.is_basis(int(value), coords[level == value]).all() for value in np.unique(level)
        )

    def is_basis(self, level: int, coords: Ints) -> Bools:
        """Which nodes belong to the composite basis."""
        basis = np.ones(coords.shape[0], dtype=np.bool_)
        if level > 0:
            basis &= self.inside(level, coords)
        if level < self.top:
            basis &= ~self.inside(level + 1, 2 * coords)
        return basis

    def _one_down(
        self, level: int, row: Ints, coords: Ints, weight: Floats
    ) -> tuple[Ints, Ints, Ints, Floats]:
        """Replace nodes outside the basis by the nodes of which they are interpolated."""
        coords = self.wrap(level, coords)
        covered = (
            self.inside(level + 1, 2 * coords)
            if level < self.top
            else np.zeros(row.size, dtype=np.bool_)
        )
        rim = ~covered & ~self.inside(level, coords) if level > 0 else np.zeros_like(covered)
        kept = ~covered & ~rim
        out = [
            (row[kept], np.full(kept.sum(), level), coords[kept], weight[kept]),
            (row[covered], np.full(covered.sum(), level + 1), 2 * coords[covered], weight[covered]),
        ]
        r, c, w = row[rim], coords[rim], weight[rim]
        for axis in range(self.dim):  # odd coordinates lie halfway between two coarser nodes
            odd = c[:, axis] % 2 == 1
            low, high = c.copy(), c[odd].copy()
            low[odd, axis] -= 1
            high[:, axis] += 1
            half = np.where(odd, 0.5, 1.0)
            r, w = np.concatenate([r, r[odd]]), np.concatenate([half * w, 0.5 * w[odd]])
            c = np.concatenate([low, high])
        out.append((r, np.full(r.size, level - 1), c // 2, w))
        rows, levels, nodes, weights = (np.concatenate(parts) for parts in zip(*out, strict=True))
        return rows, levels.astype(np.int64), nodes, weights
