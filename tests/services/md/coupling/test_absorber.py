"""The absorber of waves that the grid cannot carry, against its formula and against heat's laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_md.roles import PROJECTED
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.block import FORCE, ROW, A
from tests.services.md.driving import advance_by, energies, total

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]
RATE = 2.0
WIDTH = 12 * ROW
LONG: dict[str, Any] = {
    **FORCE,
    "domain": {"box": [[0, 12 * WIDTH], [0, WIDTH]], "periodic": [False, True]},
    "grid__cell": WIDTH / 4,
    "md__region": [[WIDTH, 11 * WIDTH], [0, WIDTH]],
    "md__variables": {"edge": "p"},
    "coupling__planes": {"left": 27 * A, "right": 109 * A},
}
"""A strip of 32 cells between two planes, periodic along y."""


def absorbing(**settings: float) -> dict[str, Any]:
    return {"coupling__absorber": {"rate": RATE, **settings}}


def band(side: MdSide) -> np.ndarray:
    return np.flatnonzero(side.atoms.role & PROJECTED)


def matrix(case: Case, x: np.ndarray, width: float) -> np.ndarray:
    """``R D R`` of atoms of mass one at ``x``, by its definition."""
    grid = make_plan(case).background_grid()
    S = np.prod(
        np.clip(1.0 - np.abs(x[:, None] - grid.positions()[None]) / grid.cell, 0.0, None), axis=2
    )
    S = S[:, S.sum(axis=0) > 0.0]
    once = np.eye(len(x)) - S @ (S.T / S.sum(axis=0)[:, None])
    planes = case.coupling.planes
    depth = np.min(
        [x[:, 0] - planes.left, planes.right - x[:, 0], x[:, 1] - planes.bottom,
         planes.top - x[:, 1]],
        axis=0,
    )  # fmt: skip
    D = np.clip(1.5 * (1.0 - depth / width), 0.0, 1.0)
    R = once @ once @ once
    return R @ (D[:, None] * R)


def held(side: MdSide) -> np.ndarray:
    return np.zeros((side.needs.size, 2))


def test_velocities_change_by_the_formula(start: Start, make: Make) -> None:
    case = make(**FORCE, **absorbing(width=5.2))
    side = start(case)
    v = side.atoms.v
    v[:] = np.random.default_rng(0).normal(size=v.shape)
    before = v.copy()
    places = band(side)
    x = side.atoms.site[places]
    depth = np.abs(x - 26.0).max(axis=1)
    assert 0 < len(x) < len(v)
    assert depth.min() == pytest.approx(
        10.3 - 5.2, abs=1.0
    )  # planes lie about 10.3 from the middle
    side._scheme.drive(held(side))
    after = side.atoms.v
    RDR = matrix(case, x, 5.2)
    np.testing.assert_allclose(RDR, RDR.T, atol=1e-14)
    expected = before[places] - RATE * times.step(case) * RDR @ before[places]
    np.testing.assert_allclose(after[places], expected, atol=1e-13)
    free = np.setdiff1d(np.flatnonzero(np.any(after != 0.0, axis=1)), places)
    np.testing.assert_array_equal(after[free], before[free])
    # energy and momentum
    lost = 0.5 * float((before[places] ** 2 - after[places] ** 2).sum())
    assert lost > 0.0
    assert side._scheme.dissipated == pytest.approx(lost, rel=1e-12)
    np.testing.assert_allclose(after[places].sum(axis=0), before[places].sum(axis=0), atol=1e-11)


def test_a_uniform_motion_is_left_alone(start: Start, make: Make) -> None:
    side = start(make(**FORCE, **absorbing()))
    v = side.atoms.v
    v[:] = (0.3, -0.2)
    side._scheme.drive(np.tile([0.3, -0.2], (side.needs.size, 1)))
    np.testing.assert_allclose(v, np.tile([0.3, -0.2], (len(v), 1)), atol=1e-14)
    assert side._scheme.dissipated == pytest.approx(0.0, abs=1e-12)


def test_the_random_force_keeps_its_temperature(start: Start, make: Make) -> None:
    """Every motion that the absorber damps gets k T / 2, to second order in the strength."""
    temperature, strength = 0.3, 0.5
    rate = strength / (20 * 0.002)
    settings = {"width": 4.0, "temperature": temperature}
    case = make(**FORCE, coupling__absorber={"rate": rate, **settings})
    side = start(case)
    places = band(side)
    x = side.atoms.site[places]
    damping, modes = np.linalg.eigh(strength * matrix(case, x, 4.0))
    damped = damping > 0.05
    assert damped.sum() > 100
    sums, samples, nodes = np.zeros(damped.sum()), 3000, held(side)
    kinetic = 0.5 * float((side.atoms.v[places] ** 2).sum())
    for k in range(samples + 100):
        side._scheme.drive(nodes)
        if k >= 100:
            sums += ((modes[:, damped].T @ side.atoms.v[places]) ** 2).sum(axis=1)
    found = sums / (2 * samples) / temperature
    a = damping[damped]
    theory = 1.0 + a * a * a / 8.0 / (2.0 * a - a * a)  # of the formula itself
    assert np.abs(theory - 1.0).max() < 0.03
    # chi-squared of so many samples, each worth about `a` of an independent one
    spread = np.sqrt(2.0 / (2 * samples * a / 2))
    assert np.abs((found - theory) / spread).max() < 5.0
    assert found.mean() == pytest.approx(theory.mean(), rel=0.01)
    gained = 0.5 * float((side.atoms.v[places] ** 2).sum()) - kinetic
    assert side._scheme.dissipated == pytest.approx(-gained, rel=1e-9)


def left_over(start: Start, make: Make, cells: float, absorber: dict[str, Any]) -> float:
    """Share of a packet's energy that comes back from a plane whose ghosts are held."""
    packet = {"center": 6 * WIDTH, "wavelength": cells * WIDTH / 4, "strain": 1e-4, "cycles": 2}
    case = make(**LONG, **absorber, initial={"packets": [packet]})
    side = start(case)
    first = total(side)
    advance_by(side, 300)
    assert total(side) + energies(side).dissipated == pytest.approx(first, rel=2e-3)
    return total(side) / first


def test_short_waves_are_absorbed_and_long_ones_are_not(start: Start, make: Make) -> None:
    assert left_over(start, make, 1.5, {}) == pytest.approx(1.0, abs=1e-3)
    assert left_over(start, make, 1.5, absorbing()) < 0.15
    # R leaves 6e-4 of the energy of the packet's carrier, more of the rest and next to the planes
    assert left_over(start, make, 8.0, absorbing()) > 0.985
