"""Parts of nodal sums that ranks hold, added up with messages between neighbours."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.halo import Halo
from tests.services.gimp.ranks import on_ranks


def test_a_program_of_one_process_sends_nothing() -> None:
    field = np.arange(6.0).reshape(3, 2)
    before = field.copy()
    Halo(None, {}).complete(field)
    np.testing.assert_array_equal(field, before)


ALL, PAIRS = 60, 3
"""Nodes that all ranks hold come first, then one for each pair of ranks, then one of each rank."""


def three_ranks() -> None:
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    rank = world.rank
    after, before = (rank + 1) % 3, (rank - 1) % 3
    every = np.arange(ALL)
    shared = {
        after: np.append(every, ALL + rank),  # the node of a pair has the number of its first rank
        before: np.append(every, ALL + before),
    }
    parts = np.random.default_rng(7).normal(size=(3, ALL + PAIRS + 1, 2))
    field, mass = parts[rank].copy(), parts[rank, :, :1].copy()
    Halo(world, shared).complete(field, mass)
    expected = parts[rank].copy()
    # from the first rank to the last, on all ranks: the same bits
    expected[every] = parts[0, every] + parts[1, every] + parts[2, every]
    expected[ALL + rank] = parts[rank, ALL + rank] + parts[after, ALL + rank]
    expected[ALL + before] = parts[before, ALL + before] + parts[rank, ALL + before]
    np.testing.assert_array_equal(field, expected)
    np.testing.assert_array_equal(mass, expected[:, :1])
    assert len(set(world.allgather(field[every].tobytes()))) == 1


def test_all_ranks_get_the_same_bits() -> None:
    on_ranks(3, __file__, "three_ranks")
