"""Threads share sweeps without changing a bit."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_gimp.sweeps import threads
from gimpmd_gimp.sweeps.threads import Team, make_stripes

NESTED = (((16, 32), (16, 32)),)


def run(size: int) -> Solver:
    """Some steps of a block with a finer middle."""
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (24, 24), (False, True), (NESTED,)))
    points = fill(mesh, 2, 1.0)
    rng = np.random.default_rng(1)
    points.v[:] = rng.uniform(-0.02, 0.02, points.v.shape)
    law = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
    solver = Solver(mesh, points, law, Method(), 0.05, threads=size)
    for _ in range(20):
        solver.step()
    return solver


@pytest.mark.parametrize("size", [2, 3])
def test_any_number_of_threads_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(threads, "SMALL", 0)
    monkeypatch.setattr(threads, "FEW", 0)
    monkeypatch.setattr(threads, "CACHED", 100)
    one, other = run(1), run(size)
    for name in ("x", "v", "F"):
        np.testing.assert_array_equal(getattr(one.points, name), getattr(other.points, name))
    np.testing.assert_array_equal(one.V, other.V)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_sums_over_nodes_do_not_depend_on_threads(
    monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(threads, "FEW", 0)
    monkeypatch.setattr(threads, "CACHED", 10)
    nodes = np.random.default_rng(3).permutation(1234)
    parts = Team(size).solve(lambda some: some.tolist(), nodes)
    assert [len(part) for part in parts] == 123 * [10] + [4]
    assert [node for part in parts for node in part] == nodes.tolist()


@pytest.mark.parametrize("size", [1, 2, 5])
def test_every_point_has_one_turn_and_stripes_stay_whole(
    monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(threads, "SMALL", 0)
    stripe = np.sort(np.random.default_rng(2).integers(0, 9, 200))
    stripe = stripe[np.argsort(stripe % 2, kind="stable")]
    stripes = make_stripes(np.arange(200), stripe)
    turns, owner, lock = np.zeros(200, dtype=int), {}, threading.Lock()

    def scatter(first: int, last: int) -> None:
        turns[first:last] += 1
        with lock:
            for number in np.unique(stripe[first:last]):
                assert owner.setdefault(number, first) == first

    Team(size).scatter(scatter, stripes)
    assert (turns == 1).all()

    parts = Team(size).gather(lambda first, last: (first, last), stripes)
    assert [i for first, last in parts for i in range(first, last)] == list(range(200))


def test_sweeps_need_no_order_for_all_points_in_turn() -> None:
    stripe = np.repeat([0, 2, 1, 3], 25)
    assert make_stripes(np.arange(100), stripe).index.size == 0
    some = np.flatnonzero(np.arange(100) % 3)
    np.testing.assert_array_equal(make_stripes(some, stripe).index, some)


def test_an_exception_in_a_thread_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "SMALL", 0)
    stripes = make_stripes(np.arange(100), np.repeat([0, 2, 1, 3], 25))

    def fails(first: int, _: int) -> None:
        if first > 0:
            raise ArithmeticError("no")

    with pytest.raises(ArithmeticError, match="no"):
        Team(2).gather(fails, stripes)
