"""Energy and forces of rods and corrected points as functions of nodal displacements."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.lattice import SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import INF, ROWS, Body, make_body

A, PAIR = SPACING, 2.0 * ROWS


@pytest.fixture(scope="module")
def body() -> Body:
    planes = ((-INF, 16 * A), (3 * PAIR, 9 * PAIR))
    return make_body(3.1, (9, 9), planes)


def displacements(body: Body, size: float, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).normal(size=(body.terms.nodes.size, 2))


def test_forces_are_the_slope_of_the_energy(body):
    U, V = displacements(body, 0.02), displacements(body, 1.0, 2)

    def slope(step: float) -> float:
        ends = (body.terms.energy(U + s * step * V) for s in (1.0, -1.0))
        return (next(ends) - next(ends)) / (2.0 * step)

    step = 1e-4
    better = (4.0 * slope(step) - slope(2.0 * step)) / 3.0
    assert -(body.terms.force(U) * V).sum() == pytest.approx(better, rel=1e-8)


def test_turned_or_shifted_bodies_have_the_same_energy_and_turned_forces(body):
    U = displacements(body, 0.02)
    x = body.grid.positions()[body.terms.nodes]
    energy, force = body.terms.evaluate(U)
    for angle in (0.3, 2.0):
        c, s = np.cos(angle), np.sin(angle)
        Q = np.array([[c, -s], [s, c]])
        turned = (x + U) @ Q.T - x + (3.0, -1.0)
        assert body.terms.energy(turned) == pytest.approx(energy, rel=1e-12)
        np.testing.assert_allclose(
            body.terms.force(turned), force @ Q.T, atol=1e-12 * np.abs(force).max()
        )
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).max()
    y = x + U
    torque = y[:, 0] * force[:, 1] - y[:, 1] * force[:, 0]
    assert abs(torque.sum()) < 1e-12 * np.abs(torque).max()


def test_small_displacements_have_linear_forces(body):
    linear, U = body.terms.linear(), displacements(body, 1.0)
    np.testing.assert_allclose(body.terms.force(0.0 * U), linear.load, atol=1e-12)
    errors = [np.abs(body.terms.force(s * U) - linear.force(s * U)).max() for s in (2e-4, 1e-4)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)  # the next order
    assert body.terms.energy(1e-4 * U) == pytest.approx(linear.energy(1e-4 * U), rel=1e-3)
    assert abs(linear.matrix - linear.matrix.T).max() < 1e-12 * abs(linear.matrix).max()


def test_rods_store_what_they_stand_for(body):
    """Uniform strain of 1 %: each rod is its share of a Lennard-Jones bond."""
    H = np.array([[0.01, 0.004], [-0.002, -0.006]])
    bonds = body.terms.take(np.arange(body.bonds.count), [])
    x = body.grid.positions()[bonds.nodes]
    R = body.bonds.ghost - body.bonds.free

    def phi(r: np.ndarray) -> np.ndarray:
        square = (r**2).sum(axis=1)
        return 4.0 * (square**-6 - square**-3)

    expected = -(body.bonds.theta * (phi(R @ (np.eye(2) + H).T) - phi(R))).sum()
    assert bonds.energy(x @ H.T) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("linear", [False, True])
def test_shares_of_ranks_sum_up(body, linear):
    whole, U = body.terms, displacements(body, 0.01)
    right = body.bonds.crossing[:, 0] > 12.0
    beside = body.correction.reference[:, 0] > 12.0
    energy, force = 0.0, np.zeros((body.grid.size, 2))
    for bonds, points in ((right, beside), (~right, ~beside), ([], [])):
        share = whole.take(bonds, points)
        used = np.isin(whole.nodes, share.nodes)
        part = share.linear() if linear else share
        energy += part.energy(U[used])
        force[share.nodes] += part.force(U[used])
    terms = whole.linear() if linear else whole
    assert energy == pytest.approx(terms.energy(U), rel=1e-12)
    np.testing.assert_allclose(force[whole.nodes], terms.force(U), atol=1e-12)
    assert np.abs(np.delete(force, whole.nodes, axis=0)).max() == 0.0
