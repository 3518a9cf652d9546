"""Nodal sums that patches share: which nodes a rank holds, and how sums are completed."""

from __future__ import annotations

import queue
import threading
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.halo import HALO_CELLS, Halo, own_patch
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((0.0, 0.0), 1.0, (40, 10), (True, False))
REGION = ((0.0, 40.0), (0.0, 10.0))
BLOCK = BackgroundGrid((0.0, 0.0, 0.0), 1.0, (20, 4, 20), (False, True, False))


class Request:
    """A persistent request of MPI, over a queue of messages."""

    def __init__(self, messages: queue.Queue[np.ndarray], buffer: np.ndarray, sends: bool) -> None:
        self.messages, self.buffer, self.sends = messages, buffer, sends

    def Start(self) -> None:
        if self.sends:
            self.messages.put(self.buffer.copy())

    def Wait(self) -> None:
        if not self.sends:
            self.buffer[:] = self.messages.get(timeout=10.0)


class Communicator:
    """What `Halo` needs of mpi4py, for ranks that are threads."""

    def __init__(self, rank: int, queues: list[list[queue.Queue[np.ndarray]]]) -> None:
        self.rank, self.size, self._queues = rank, len(queues), queues

    def Recv_init(self, buffer: np.ndarray, source: int) -> Request:
        return Request(self._queues[source][self.rank], buffer, sends=False)

    def Send_init(self, buffer: np.ndarray, dest: int) -> Request:
        return Request(self._queues[self.rank][dest], buffer, sends=True)


def communicators(size: int) -> list[Any]:
    queues: list[list[queue.Queue[np.ndarray]]] = [
        [queue.Queue() for _ in range(size)] for _ in range(size)
    ]
    return [Communicator(rank, queues) for rank in range(size)]


@pytest.mark.parametrize(
    ("grid", "counts"), [(GRID, (3, 1)), (GRID, (2, 2)), (BLOCK, (2, 1, 2)), (BLOCK, (1, 1, 1))]
)
def test_every_rank_gets_the_sums_of_all(grid: BackgroundGrid, counts: tuple[int, ...]) -> None:
    region = tuple((0.0, float(n)) for n in grid.cells)
    ranks = communicators(int(np.prod(counts)))
    halos = [Halo(comm, grid, region, counts) for comm in ranks]
    parts = []
    for comm, halo in zip(ranks, halos, strict=True):
        row = np.full(grid.size, -1)
        row[halo.nodes] = np.arange(halo.nodes.size)
        halo.connect(lambda ids, row=row: row[ids], width=2)
        parts.append(np.random.default_rng(comm.rank).normal(size=(halo.nodes.size, 2)))
    total = np.zeros((grid.size, 2))
    for halo, part in zip(halos, parts, strict=True):
        total[halo.nodes] += part  # in the order of the ranks
    threads = [
        threading.Thread(target=halo.complete, args=(part,))
        for halo, part in zip(halos, parts, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for halo, part in zip(halos, parts, strict=True):
        np.testing.assert_array_equal(part, total[halo.nodes])


def test_a_rank_holds_the_nodes_near_its_patch_also_across_periodic_faces() -> None:
    halo = Halo(communicators(4)[0], GRID, REGION, (4, 1))
    assert halo.patch == ((0.0, 10.0), (0.0, 10.0))
    x = GRID.positions()
    near = (x[:, 0] <= 10.0 + HALO_CELLS) | (x[:, 0] >= 40.0 - HALO_CELLS)
    np.testing.assert_array_equal(halo.nodes, np.flatnonzero(near & GRID.canonical()))
    wanted = np.flatnonzero(x[:, 0] == 5.0)
    few = Halo(communicators(4)[0], GRID, REGION, (4, 1), wanted)
    np.testing.assert_array_equal(few.nodes, np.intersect1d(wanted, halo.nodes))


def test_the_number_of_ranks_must_be_that_of_the_patches() -> None:
    three, four = communicators(3)[2], communicators(4)[3]
    assert own_patch(REGION, (2, 2), four) == ((20.0, 40.0), (5.0, 10.0))
    with pytest.raises(BackendError, match=r"started on 3 MPI ranks.* into 2 x 2; start 4 ranks"):
        own_patch(REGION, (2, 2), three)
