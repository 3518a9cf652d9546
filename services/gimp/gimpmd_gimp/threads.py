"""Sweeps shared among threads: same sums, in the same order, for any number of threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from gimpmd_schemas.grid import Ints

BLOCK_ROWS = 4
"""Rows of nodes in a block. Points may drift one row before two blocks of a colour could meet."""

SMALL = 8192
"""Below so many points a sweep is over before a second thread would have woken up."""

Part = tuple[int, int]
T = TypeVar("T")


@dataclass(frozen=True)
class Blocks:
    """Points sorted into blocks of node rows: all even blocks, then all odd ones.

    Blocks of one parity share no node, so threads may scatter them at the same time. A node gets
    its sums from at most one even and then one odd block, whoever works on them.

    Attributes
    ----------
    order : ndarray of int64, shape ``(m,)``
        Indices of the points.
    even, odd : ndarray of int64
        Where the blocks of each parity begin in ``order``, and where the last one ends.
    """

    order: Ints
    even: Ints
    odd: Ints


def make_blocks(chosen: Ints, row: Ints, rows: int) -> Blocks:
    """Sort the points ``chosen`` by the block in which their first row of nodes lies.

    Parameters
    ----------
    chosen : ndarray of int64
        Indices of points.
    row : ndarray of int64, shape ``(n,)``
        First node row of every point's stencil.
    rows : int
        Number of node rows of the grid.
    """
    block = row[chosen] // BLOCK_ROWS
    count = -(-rows // BLOCK_ROWS)
    numbers = np.concatenate([np.arange(0, count, 2), np.arange(1, count, 2)])
    rank = np.empty(count, dtype=np.int64)
    rank[numbers] = np.arange(count)
    order = chosen[np.argsort(rank[block], kind="stable")]
    sizes = np.bincount(rank[block], minlength=count)
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    middle = (count + 1) // 2
    return Blocks(order, start[: middle + 1], start[middle:])


class Team:
    """A few threads that share sweeps.

    Parameters
    ----------
    size : int
        Threads, the caller's own included.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pool = ThreadPoolExecutor(size - 1) if size > 1 else None

    def scatter(self, work: Callable[[int, int], object], blocks: Blocks) -> None:
        """Run ``work(first, last)`` over all points, no node being written twice at a time."""
        if self._alone(blocks):
            work(0, blocks.order.size)
            return
        for starts in (blocks.even, blocks.odd):
            self._run(work, self._share(starts))

    def gather(self, work: Callable[[int, int], T], blocks: Blocks) -> list[T]:
        """Run ``work(first, last)``, which writes to points alone; returns what the parts did."""
        if self._alone(blocks):
            return [work(0, blocks.order.size)]
        cuts = np.linspace(0, blocks.order.size, self.size + 1).astype(int).tolist()
        return self._run(work, list(pairwise(cuts)))

    def _alone(self, blocks: Blocks) -> bool:
        return self._pool is None or blocks.order.size < SMALL

    def _share(self, starts: Ints) -> list[Part]:
        """Whole blocks for every thread, with about as many points each."""
        first, last = int(starts[0]), int(starts[-1])
        ideal = np.linspace(first, last, self.size + 1)
        cuts = starts[np.searchsorted(starts, ideal)].tolist()
        return list(pairwise(cuts))

    def _run(self, work: Callable[[int, int], T], parts: list[Part]) -> list[T]:
        if self._pool is None:
            return [work(*part) for part in parts]
        others = [self._pool.submit(work, *part) for part in parts[1:]]
        return [work(*parts[0]), *(other.result() for other in others)]
