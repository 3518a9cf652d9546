"""Sums over atoms, in two and three dimensions, against numpy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_md.sums import extent, mean_velocity, power, power_of, spacing_of, tally

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("dim", [2, 3])
def test_tally_and_power(dim: int) -> None:
    role = RNG.integers(0, 8, 50).astype(np.int32)
    m, potential = RNG.random(50), RNG.normal(size=50)
    v, f = RNG.normal(size=(2, 50, dim))
    mass, momentum, twice_kinetic, energy = tally(role, 2, m, v, 3, potential)
    core, bonded = (role & 2) != 0, (role & 3) != 0
    assert mass == pytest.approx(m[core].sum())
    np.testing.assert_allclose(momentum, (m[:, None] * v)[core].sum(axis=0))
    assert twice_kinetic == pytest.approx((m * (v * v).sum(axis=1))[core].sum())
    assert energy == pytest.approx(potential[bonded].sum())
    assert power(role, 2, v, f) == pytest.approx((v * f)[core].sum())
    assert power_of(np.flatnonzero(core), v, f) == power(role, 2, v, f)


@pytest.mark.parametrize("dim", [2, 3])
def test_mean_velocity_takes_the_nearest_image(dim: int) -> None:
    period = np.array([0.0, 4.0, 6.0])[:dim]
    last, moved = RNG.random((20, dim)), RNG.uniform(-1.0, 1.0, (20, dim))
    x, q = last + moved + period * RNG.integers(-1, 2, (20, dim)), np.empty((20, dim))
    mean_velocity(x, last, period, 0.5, q)
    np.testing.assert_allclose(q, moved / 0.5, atol=1e-14)


def test_extent_is_that_of_all_ranks() -> None:
    others = np.array([[np.inf, np.inf], [-np.inf, -np.inf]])  # a rank without atoms
    comm = SimpleNamespace(allgather=lambda bounds: [bounds, others])
    low, high = extent(comm, np.array([[1.0, 5.0], [2.0, -1.0]]))
    np.testing.assert_array_equal([low, high], [[1.0, -1.0], [2.0, 5.0]])


def test_spacing_is_a_root_of_the_volume_per_atom() -> None:
    assert spacing_of(8.0, 4, 0.5, 2) == 2.0
    assert spacing_of(32.0, 4, 1.0, 3) == pytest.approx(2.0)
