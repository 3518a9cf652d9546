"""Nodal sums and what is solved from them, on the nodes that take part in a step."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.grid.nodes import Nodes, make_active_set
from gimpmd_gimp.sweeps.threads import Team
from tests.services.gimp.ranks import on_ranks

FLOOR = 1e-9


def nested(comm=None) -> Mesh:
    finer = ((((16, 32), (12, 36)),),)
    return Mesh(Hierarchy((0.0, 0.0), 1.0, (24, 24), (False, True), finer), comm)


def nodes_of(mesh: Mesh, threads: int = 1, viscous: bool = False) -> Nodes:
    return Nodes(mesh, Team(threads), FLOOR, viscous)


def used(mesh: Mesh) -> np.ndarray:
    """Nodes of the basis and those that depend on them."""
    found = mesh.basis.copy()
    found[mesh.constraints.node] = True
    return found


def test_all_nodes_take_part_when_the_coarsest_level_steps() -> None:
    mesh = nested()
    whole, fine = (make_active_set(mesh, level) for level in (0, 1))
    np.testing.assert_array_equal(whole.solved, np.flatnonzero(mesh.basis))
    np.testing.assert_array_equal(whole.cleared, np.arange(mesh.size))
    assert set(fine.solved) < set(whole.solved)
    finer_basis = np.flatnonzero(mesh.basis & (mesh.level == 1))
    assert set(finer_basis) < set(fine.solved)
    for active in (whole, fine):
        both = np.concatenate([active.solved, active.unsolved])
        np.testing.assert_array_equal(np.sort(both), active.cleared)
        assert np.isin(active.constraints.node, active.cleared).all()
        assert np.isin(active.constraints.parent, active.cleared).all()


def test_clear_leaves_other_nodes_alone() -> None:
    nodes = nodes_of(nested())
    nodes.P[:] = 1.0
    nodes.M[:] = 2.0
    nodes.clear(1, nodes.P, nodes.M[:, None])
    cleared = nodes.active[1].cleared
    np.testing.assert_array_equal(nodes.P[cleared], 0.0)
    np.testing.assert_array_equal(nodes.M[cleared], 0.0)
    np.testing.assert_array_equal(np.delete(nodes.P, cleared, axis=0), 1.0)
    np.testing.assert_array_equal(np.delete(nodes.M, cleared), 2.0)


@pytest.mark.parametrize("level", [0, 1])
def test_complete_keeps_the_total_and_leaves_nothing_on_constrained_nodes(level) -> None:
    mesh = nested()
    nodes = nodes_of(mesh)
    active = nodes.active[level]
    takes_part = np.zeros(mesh.size, dtype=np.bool_)
    takes_part[active.cleared] = True
    takes_part &= used(mesh)
    rng = np.random.default_rng(0)
    P, M = (rng.normal(size=(mesh.size, k)) * takes_part[:, None] for k in (2, 1))
    totals = P.sum(axis=0), M.sum(axis=0)
    nodes.complete(level, P, M)
    for found, total in zip((P, M), totals, strict=True):
        np.testing.assert_allclose(found.sum(axis=0), total, rtol=1e-12)
        np.testing.assert_array_equal(found[active.constraints.node], 0.0)


def test_divide_add_and_work_are_sums_over_the_solved_nodes() -> None:
    mesh = nested()
    nodes = nodes_of(mesh, threads=3)
    rng = np.random.default_rng(1)
    nodes.M[:] = rng.uniform(0.5, 1.5, mesh.size)
    light = nodes.active[1].solved[::7]
    nodes.M[light] = FLOOR
    P, before = rng.normal(size=(2, mesh.size, 2))
    V = before.copy()
    nodes.divide(1, P, V)
    solved = nodes.active[1].solved
    expected = before.copy()
    expected[solved] = P[solved] / nodes.M[solved, None]
    expected[light] = 0.0
    np.testing.assert_allclose(V, expected, rtol=1e-15)

    nodes.add(1, P, 0.25, V)
    expected[solved] += 0.25 * P[solved]
    np.testing.assert_allclose(V, expected, rtol=1e-15)

    nodes.V[:] = V
    counts = (np.arange(mesh.size) % 3 == 0).astype(float)
    P[solved[::4]] = 0.0
    work = counts[solved] @ (P[solved] * V[solved]).sum(axis=1)
    carrying = nodes.carrying(1, P, counts)
    expected = solved[(counts[solved] > 0.0) & P[solved].any(axis=1)]
    np.testing.assert_array_equal(carrying, expected)
    assert nodes.work(carrying, P, counts) == pytest.approx(work, rel=1e-12)


def test_prolong_takes_the_values_of_the_parents() -> None:
    mesh = nested()
    field = np.where(used(mesh)[:, None], 2.0 + 3.0 * mesh.positions()[:, :1], 0.0)
    exact = field.copy()
    field[mesh.constraints.node] = np.nan
    nodes_of(mesh).prolong(0, field)
    np.testing.assert_allclose(field, exact, rtol=1e-14)


def test_dashpots_take_memory_only_where_they_are() -> None:
    mesh = nested()
    assert nodes_of(mesh).dashpot.shape == (0, 2)
    assert nodes_of(mesh, viscous=True).dashpot.shape == (mesh.size, 2)


def sums_over_ranks() -> None:
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    mesh, whole = nested(world), nested()
    rng = np.random.default_rng(world.rank)
    P = rng.normal(size=(mesh.size, 2)) * used(mesh)[:, None]
    part = world.allreduce(P.sum(axis=0))
    nodes_of(mesh).complete(0, P)
    # every node is counted by one rank, and all ranks that hold it have the same bits
    total = world.allreduce((P * mesh.counts[:, None]).sum(axis=0))
    np.testing.assert_allclose(total, part, rtol=1e-12)
    held = {}
    for level in (0, 1):
        here = np.flatnonzero(mesh.basis & (mesh.level == level))
        names = mesh.hierarchy.wrap(level, mesh.coords[here]).tolist()
        held |= {(level, *name): P[i].tolist() for name, i in zip(names, here, strict=True)}
    everywhere = world.allgather(held)
    for other in everywhere:
        for key in set(held) & set(other):
            assert other[key] == held[key]
    assert len(set().union(*everywhere)) == whole.basis.sum()
    assert world.allreduce(int(mesh.counts.sum())) == whole.basis.sum()


def test_parts_of_ranks_are_added_up() -> None:
    on_ranks(2, __file__, "sums_over_ranks")
