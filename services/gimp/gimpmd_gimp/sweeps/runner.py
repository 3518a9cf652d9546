"""Chains of sweeps over material points.

Sweeps over the same points run as a chain: all of them handle one part of the points while these
are in the cache, then the next part. Memory is then read once for the whole chain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from gimpmd_gimp.sweeps.threads import CACHED, Stripes, Team


@dataclass(frozen=True)
class Sweep:
    """One pass over some points.

    Attributes
    ----------
    stripes : Stripes
        The points.
    work : callable
        ``work(stripes, first, last)`` handles the points ``first`` to ``last`` of the stripes.
    to_nodes : bool
        Whether the sweep writes to nodes. If not, it writes only to its own points.
    """

    stripes: Stripes
    work: Callable[[Stripes, int, int], object]
    to_nodes: bool


def run_sweeps(team: Team, sweeps: Sequence[Sweep]) -> None:
    """Run sweeps in order; consecutive sweeps over the same stripes form a chain.

    No sweep may read nodes that an earlier one in the list writes.
    """
    for _, links in groupby(sweeps, key=lambda sweep: id(sweep.stripes)):
        _run_chain(team, list(links))


def _run_chain(team: Team, links: Sequence[Sweep]) -> None:
    stripes = links[0].stripes
    length = CACHED if len(links) > 1 else max(stripes.order.size, 1)

    def part(first: int, last: int) -> None:
        for start in range(first, last, length):
            for link in links:
                link.work(stripes, start, min(start + length, last))

    share = team.scatter if any(link.to_nodes for link in links) else team.gather
    share(part, stripes)
