"""Sweeps shared among threads. Sums have the same order for any number of threads."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import TypeVar

import numpy as np

from gimpmd_schemas.arrays import Ints

STRIPE_ROWS = 4
"""Rows of nodes in a stripe. Points of two stripes with one stripe between them share no node."""

SMALL, FEW = 20_000, 80_000
"""With fewer points, or nodes, a sweep ends before a second thread has started."""

CACHED = 16384
"""Number of points, or nodes, that stay in the cache between two sweeps of a chain."""

Part = tuple[int, int]
T = TypeVar("T")


@dataclass(frozen=True)
class Stripes:
    """Points sorted into stripes of node rows: first all even stripes, then all odd ones.

    Stripes of one parity share no node, so threads may scatter them at the same time. A node gets
    contributions from at most one even and then one odd stripe, whichever threads work on them.

    Attributes
    ----------
    order : ndarray of int64, shape ``(m,)``
        Indices of the points.
    index : ndarray of int64
        The same for sweeps: empty if the order is 0 to m - 1, which saves reading it.
    even, odd : ndarray of int64
        Where the stripes of each parity begin in ``order``, and the end of the last one.
    """

    order: Ints
    index: Ints
    even: Ints
    odd: Ints


def make_stripes(order: Ints, stripe: Ints) -> Stripes:
    """Stripes of points that are already sorted by parity of the stripe, then by stripe.

    Parameters
    ----------
    order : ndarray of int64, shape ``(m,)``
    stripe : ndarray of int64, shape ``(n,)``
        Stripe of every point.
    """
    mine = stripe[order]
    starts = np.flatnonzero(np.diff(mine, prepend=-1) != 0)
    first_odd = int(np.count_nonzero(mine[starts] % 2 == 0))
    ends = np.append(starts, order.size).astype(np.int64)
    in_turn = bool((order == np.arange(order.size)).all())
    return Stripes(order, order[:0] if in_turn else order, ends[: first_odd + 1], ends[first_odd:])


class Team:
    """Threads that share sweeps.

    Parameters
    ----------
    size : int
        Number of threads, the calling one included.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pool = ThreadPoolExecutor(size - 1) if size > 1 else None

    def scatter(self, work: Callable[[int, int], object], stripes: Stripes) -> None:
        """Run ``work(first, last)`` over all points; no two threads write to one node at a time."""
        if self._runs_alone(stripes.order.size):
            work(0, stripes.order.size)
            return
        for starts in (stripes.even, stripes.odd):
            self._run(work, self._whole_stripes(starts))

    def gather(self, work: Callable[[int, int], T], stripes: Stripes) -> list[T]:
        """Run ``work(first, last)``, which writes only to points; return the results."""
        return self.share(work, stripes.order.size)

    def share(self, work: Callable[[int, int], T], count: int) -> list[T]:
        """Run ``work(first, last)`` over ``count`` rows that are written independently."""
        if self._runs_alone(count):
            return [work(0, count)]
        return self._run(work, self._cut(count))

    def solve(self, work: Callable[[Ints], T], nodes: Ints) -> list[T]:
        """Run ``work`` on nodes, piece by piece; return the results of the pieces.

        The pieces, and therefore their sums, are the same for any number of threads.
        """
        starts = range(0, nodes.size, CACHED)

        def part(first: int, last: int) -> list[T]:
            return [work(nodes[start : start + CACHED]) for start in starts[first:last]]

        if self._pool is None or nodes.size < FEW:
            return part(0, len(starts))
        return list(chain.from_iterable(self._run(part, self._cut(len(starts)))))

    def _cut(self, count: int) -> list[Part]:
        """Equal parts, one for each thread."""
        return list(pairwise(count * k // self.size for k in range(self.size + 1)))

    def _runs_alone(self, count: int) -> bool:
        return self._pool is None or count < SMALL

    def _whole_stripes(self, starts: Ints) -> list[Part]:
        """Whole stripes for every thread, with about the same number of points."""
        first, last = int(starts[0]), int(starts[-1])
        cuts = [first]
        for k in range(1, self.size):
            ideal = first + (last - first) * k / self.size
            after = bisect_left(starts, ideal)
            before = max(after - 1, 0)
            closer = after if starts[after] - ideal < ideal - starts[before] else before
            cuts.append(int(starts[closer]))
        return list(pairwise([*cuts, last]))

    def _run(self, work: Callable[[int, int], T], parts: list[Part]) -> list[T]:
        if self._pool is None:
            return [work(*part) for part in parts]
        others = [self._pool.submit(work, *part) for part in parts[1:]]
        return [work(*parts[0]), *(other.result() for other in others)]
