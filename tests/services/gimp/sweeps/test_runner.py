"""Chains of sweeps: same bits as sweeps one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.clock import Integrator
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_gimp.sweeps import runner
from gimpmd_gimp.sweeps.runner import Sweep, run_sweeps
from gimpmd_gimp.sweeps.threads import Team, make_stripes


def test_sweeps_over_the_same_points_form_a_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """All sweeps of a chain handle a part of the points before the next part begins."""
    monkeypatch.setattr(runner, "CACHED", 4)
    stripes, others = (make_stripes(np.arange(n), np.zeros(n, dtype=np.int64)) for n in (10, 3))
    calls: list[tuple[str, int, int]] = []

    def sweep(name: str, points) -> Sweep:
        return Sweep(points, lambda _, first, last: calls.append((name, first, last)), False)

    run_sweeps(Team(1), [sweep("a", stripes), sweep("b", stripes), sweep("c", others)])
    parts = [(0, 4), (4, 8), (8, 10)]
    assert calls == [(name, *part) for part in parts for name in "ab"] + [("c", 0, 3)]


def run(integrator: Integrator) -> Solver:
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (24, 24), (False, True)))
    points = fill(mesh, 2, 1.0)
    points.v[:] = np.random.default_rng(1).uniform(-0.02, 0.02, points.v.shape)
    solver = Solver(
        mesh, points, LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0), Method(integrator), 0.05
    )
    for _ in range(20):
        solver.step()
    return solver


@pytest.mark.parametrize("integrator", ["usavg", "musl", "usl", "usf"])
def test_chains_give_the_same_bits(monkeypatch: pytest.MonkeyPatch, integrator: Integrator) -> None:
    one = run(integrator)
    monkeypatch.setattr(runner, "CACHED", 7)
    other = run(integrator)
    for name in ("x", "v", "F"):
        np.testing.assert_array_equal(getattr(one.points, name), getattr(other.points, name))
    np.testing.assert_array_equal(one.V, other.V)
