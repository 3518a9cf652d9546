"""The absorber of waves that the grid cannot carry, against its formula and against heat's laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gimpmd_md.roles import BOUNDARY, PROJECTED
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.interface_nodes import fit_nodes
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.block import FORCE, ROW, A
from tests.services.md.coupling import dense_fit
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


@dataclass(frozen=True)
class Particles:
    """What the fit sees on one rank, and the absorber by its definition: ``A = g dt P``."""

    rows: np.ndarray
    nodes: np.ndarray
    """Among the nodes that the side needs."""
    mass: np.ndarray
    P: np.ndarray

    @classmethod
    def of(cls, side: MdSide, case: Case, width: float) -> Particles:
        plan, rows = make_plan(case), band(side)
        grid, seen = plan.background_grid(), fit_nodes(plan)
        atoms, nodes = side.atoms.site[rows], grid.positions()[seen]
        x = np.concatenate([atoms, nodes])
        of_node = plan.continuum.material.density * grid.cell**2
        mass = np.concatenate([side.atoms.mass[rows], np.full(seen.size, of_node)])
        q = depth(case, x) / width
        D = np.where((q > 0.0) & (q < 1.0), 1.0 - 3.0 * q**2 + 2.0 * q**3, 0.0)
        R = dense_fit.rest(grid, x, mass)
        P = R.T @ ((mass * D)[:, None] * R) / mass[:, None]
        return cls(rows, np.searchsorted(side.needs, seen), mass, P)

    def split(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return v[: len(self.rows)], v[len(self.rows) :]

    def velocities(self, side: MdSide, V: np.ndarray) -> np.ndarray:
        return np.concatenate([side.atoms.v[self.rows], V[self.nodes]])


def depth(case: Case, x: np.ndarray) -> np.ndarray:
    planes = case.coupling.planes
    return np.min(
        [x[:, 0] - planes.left, planes.right - x[:, 0], x[:, 1] - planes.bottom,
         planes.top - x[:, 1]],
        axis=0,
    )  # fmt: skip


def damp(side: MdSide, V: np.ndarray) -> np.ndarray:
    """One application, without MD steps between; returns the impulses on the nodes needed."""
    side._scheme.drive(V)
    step = side._plan.step
    still = side._scheme.fields(0.0)["force"]
    force = side._scheme.fields(step)["force"]
    np.testing.assert_array_equal(side.offers, side.needs)  # on one rank
    return step * (force - still)


def test_velocities_change_by_the_formula(start: Start, make: Make) -> None:
    width = 4.0
    case = make(**FORCE, **absorbing(width=width))
    side = start(case)
    found, rng = Particles.of(side, case, width), np.random.default_rng(0)
    side.atoms.v[:] = rng.normal(size=side.atoms.v.shape)
    V = rng.normal(size=(side.needs.size, 2))
    assert 0 < len(found.rows) < len(side.atoms.v)
    strength = RATE * times.step(case)
    # what the ghosts get does not matter here: they are no free atoms
    before, old = side.atoms.v.copy(), found.velocities(side, V)
    J = damp(side, V)
    expected = old - strength * found.P @ old
    atoms, nodes = found.split(expected)
    np.testing.assert_allclose(side.atoms.v[found.rows], atoms, atol=1e-12)
    m = found.split(found.mass[:, None])[1]
    np.testing.assert_allclose(J[found.nodes], m * (nodes - V[found.nodes]), atol=1e-11)
    others = np.setdiff1d(np.arange(len(V)), found.nodes)
    np.testing.assert_allclose(J[others], 0.0, atol=1e-12)
    free = np.setdiff1d(np.flatnonzero((side.atoms.role & BOUNDARY) == 0), found.rows)
    np.testing.assert_array_equal(side.atoms.v[free], before[free])
    # momentum stays, and energy is booked: of nodes half before their kick, half after it
    change = found.mass[:, None] * (expected - old)
    np.testing.assert_allclose(change.sum(axis=0), 0.0, atol=1e-10)
    lost = 0.5 * float((before[found.rows] ** 2 - atoms**2).sum())
    later = rng.normal(size=V.shape)
    side._scheme.drive(later)
    taken = -float((J * 0.5 * (V + later)).sum())
    assert side._scheme.dissipated == pytest.approx(lost + taken, rel=1e-12)
    assert side._scheme.work_of_nodes == pytest.approx(taken, rel=1e-12)
    # energy of free bodies falls
    root = np.sqrt(found.mass)[:, None]
    shares = np.linalg.eigvalsh(found.P * root / root.T)
    assert shares[0] > -1e-12
    assert 0.9 < shares[-1] < 1.001


def test_a_linear_motion_is_left_alone(start: Start, make: Make) -> None:
    """Translation, rotation and strain rate."""
    side = start(make(**FORCE, **absorbing()))
    slope, mean = np.array([[0.02, -0.01], [0.03, 0.015]]), np.array([0.3, -0.2])
    x = make_plan(make(**FORCE)).background_grid().positions()[side.needs]
    side.atoms.v[:] = side.atoms.site @ slope + mean
    before = side.atoms.v[band(side)]
    J = damp(side, x @ slope + mean)
    np.testing.assert_allclose(side.atoms.v[band(side)], before, atol=1e-14)
    np.testing.assert_allclose(J, 0.0, atol=1e-13)
    assert side._scheme.dissipated == pytest.approx(0.0, abs=1e-11)


def test_the_random_force_keeps_its_temperature(start: Start, make: Make) -> None:
    """Every motion that the absorber damps gets k T / 2, to second order in the strength.

    Nodes move freely here, with the mass that the fit gives them.
    """
    temperature, strength = 0.3, 0.38
    rate = strength / (20 * 0.002)
    settings = {"width": 4.0, "temperature": temperature}
    case = make(**FORCE, coupling__absorber={"rate": rate, **settings})
    side = start(case)
    found = Particles.of(side, case, 4.0)
    root = np.sqrt(found.mass)[:, None]
    damping, modes = np.linalg.eigh(strength * found.P * root / root.T)
    damped = damping > 0.05
    assert damped.sum() > 100
    sums, samples, V = np.zeros(damped.sum()), 1500, np.zeros((side.needs.size, 2))
    of_node = side._plan.continuum.material.density * case.grid.cell**2
    for k in range(samples + 100):
        side._scheme.drive(V)
        side._scheme.fields(side._plan.step)
        V[found.nodes] += side._scheme._absorber.impulse / of_node
        if k >= 100:
            v = root * found.velocities(side, V)
            sums += ((modes[:, damped].T @ v) ** 2).sum(axis=1)
    ratio = sums / (2 * samples) / temperature
    a = damping[damped]
    theory = 1.0 + a * a * a / 8.0 / (2.0 * a - a * a)  # of the formula itself
    assert np.abs(theory - 1.0).max() < 0.03
    # chi-squared of so many samples, each worth about `a` of an independent one
    spread = np.sqrt(2.0 / (2 * samples * a / 2))
    assert np.abs((ratio - theory) / spread).max() < 5.0
    assert ratio.mean() == pytest.approx(theory.mean(), rel=0.015)


def test_a_strong_random_force_acts_in_parts(start: Start, make: Make) -> None:
    """Of a strength of .4 and less each: the error is of second order in it."""
    rate = 1.0 / (20 * 0.002)
    for temperature, times_a_step in ((0.0, 1), (0.3, 3)):
        settings = {"rate": rate, "temperature": temperature}
        side = start(make(**FORCE, coupling__absorber=settings))
        damp(side, np.zeros((side.needs.size, 2)))
        assert side._scheme._absorber._step == times_a_step


def left_over(start: Start, make: Make, cells: float, absorber: dict[str, Any]) -> float:
    """Share of a packet's energy that comes back from a plane whose ghosts are held."""
    packet = {"center": 6 * WIDTH, "wavelength": cells * WIDTH / 4, "strain": 1e-4, "cycles": 2}
    case = make(**LONG, **absorber, initial={"packets": [packet]})
    side = start(case)
    first = total(side)
    advance_by(side, 300)
    assert total(side) + energies(side).dissipated == pytest.approx(first, rel=2e-3)
    return total(side) / first


def test_short_waves_are_absorbed(start: Start, make: Make) -> None:
    """For long ones the nodes must move too: `tests/physics/test_absorber.py`."""
    assert left_over(start, make, 1.5, {}) == pytest.approx(1.0, abs=1e-3)
    assert left_over(start, make, 1.5, absorbing()) < 0.05
