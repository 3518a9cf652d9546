"""Nodal sums that patches share: which nodes a rank holds, and how sums are completed."""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.halo import HALO_CELLS, SURROUND_CELLS, Exchange, Halo, own_patch
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

    def Free(self) -> None:
        self.buffer = None


class Communicator:
    """What `Halo` needs of mpi4py, for ranks that are threads."""

    def __init__(self, rank: int, queues: list[list[queue.Queue[Any]]]) -> None:
        self.rank, self.size, self._queues = rank, len(queues), queues

    def allgather(self, value: Any) -> list[Any]:
        for messages in self._queues[self.rank]:
            messages.put(value)
        return [self._queues[source][self.rank].get(timeout=10.0) for source in range(self.size)]

    def allreduce(self, value: int) -> int:
        return sum(self.allgather(value))

    def Recv_init(self, buffer: np.ndarray, source: int) -> Request:
        return Request(self._queues[source][self.rank], buffer, sends=False)

    def Send_init(self, buffer: np.ndarray, dest: int) -> Request:
        return Request(self._queues[self.rank][dest], buffer, sends=True)


def communicators(size: int) -> list[Any]:
    queues: list[list[queue.Queue[Any]]] = [
        [queue.Queue() for _ in range(size)] for _ in range(size)
    ]
    return [Communicator(rank, queues) for rank in range(size)]


def on_every_rank(work: Callable[[Any], Any], things: list[Any]) -> list[Any]:
    """Do collective work with one thing of each rank; the results."""
    with ThreadPoolExecutor(len(things)) as pool:
        return list(pool.map(work, things))


def check_sums(grid: BackgroundGrid, halos: list[Halo]) -> None:
    """Every rank gets the sums of all parts, in the order of the ranks."""
    parts = [np.random.default_rng(h.comm.rank).normal(size=(h.nodes.size, 2)) for h in halos]
    total = np.zeros((grid.size, 2))
    for halo, part in zip(halos, parts, strict=True):
        total[halo.nodes] += part
    exchanges = [Exchange(halo, halo.rows, width=2) for halo in halos]
    on_every_rank(lambda rank: exchanges[rank].complete(parts[rank]), list(range(len(halos))))
    for halo, part in zip(halos, parts, strict=True):
        np.testing.assert_array_equal(part, total[halo.nodes])


@pytest.mark.parametrize(
    ("grid", "counts"), [(GRID, (3, 1)), (GRID, (2, 2)), (BLOCK, (2, 1, 2)), (BLOCK, (1, 1, 1))]
)
def test_every_rank_gets_the_sums_of_all(grid: BackgroundGrid, counts: tuple[int, ...]) -> None:
    region = tuple((0.0, float(n)) for n in grid.cells)
    halos = [Halo(comm, grid, region, counts) for comm in communicators(int(np.prod(counts)))]
    check_sums(grid, halos)
    nodes = np.concatenate([halo.own for halo in halos])  # each node has one owner
    np.testing.assert_array_equal(np.sort(nodes), np.flatnonzero(grid.canonical()))


@pytest.mark.parametrize(("grid", "counts"), [(GRID, (4, 1)), (BLOCK, (2, 1, 2))])
def test_ranks_hold_the_nodes_around_their_atoms_too(
    grid: BackgroundGrid, counts: tuple[int, ...]
) -> None:
    """Rank 0 has atoms from far away, rank 1 has none; all others stay at home."""
    region = tuple((0.0, float(n)) for n in grid.cells)
    wanted = np.flatnonzero(grid.canonical() & (grid.positions()[:, 1] < 3.0))
    halos = [Halo(comm, grid, region, counts, wanted) for comm in communicators(4)]
    homes = [halo.nodes for halo in halos]
    corner = grid.cell * np.array(grid.cells, dtype=np.float64) - 0.4
    atom = np.where(np.arange(grid.dim) == 1, 1.0, 0.5 * corner if grid is GRID else corner)
    sites = [atom[None], *[np.empty((0, grid.dim))] * 3]
    on_every_rank(lambda rank: halos[rank].surround(sites[rank]), [0, 1, 2, 3])
    away = np.abs(grid.positions()[wanted] - np.rint(atom)).max(axis=1)
    around = wanted[away <= SURROUND_CELLS]
    assert np.setdiff1d(around, homes[0]).size
    np.testing.assert_array_equal(halos[0].nodes, np.union1d(homes[0], around))
    for halo, home in zip(halos[1:], homes[1:], strict=True):
        np.testing.assert_array_equal(halo.nodes, home)
    check_sums(grid, halos)
    # what belongs to nodes reaches the ranks that hold them, from the owners
    field = np.random.default_rng(7).normal(size=(grid.size, 2))
    found = on_every_rank(lambda halo: halo.distribute(field[halo.home]), halos)
    for halo, values in zip(halos, found, strict=True):
        np.testing.assert_array_equal(values, field[halo.nodes])
    # and all is as it was when the atoms are back
    on_every_rank(lambda halo: halo.surround(np.empty((0, grid.dim))), halos)
    for halo, home in zip(halos, homes, strict=True):
        np.testing.assert_array_equal(halo.nodes, home)


def test_nodes_around_an_atom_repeat_across_periodic_faces_and_end_at_others() -> None:
    halo = Halo(communicators(1)[0], GRID, ((18.0, 19.0), (0.0, 10.0)), (1, 1))
    x = GRID.positions()
    for atom in ([39.8, 9.0], [-0.2, 9.0], [79.8, 9.0]):
        halo.surround(np.array([atom, [25.0, np.nan], [25.0, 100.0]]))
        near = ((x[:, 0] <= 4.0) | (x[:, 0] >= 36.0)) & (x[:, 1] >= 5.0) & GRID.canonical()
        expected = np.union1d(halo.home, np.flatnonzero(near))
        np.testing.assert_array_equal(halo.nodes, expected)


def test_a_rank_holds_the_nodes_near_its_patch_also_across_periodic_faces() -> None:
    halo = Halo(communicators(4)[0], GRID, REGION, (4, 1))
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
