"""J2 plasticity against closed forms: along strain paths at a point, and in a bar and its waves."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import J2Plasticity
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.services.gimp.laws.sample_laws import at_rest, energy, gradients, plastic, stress

LAME, SHEAR, YIELD, HARDENING = 1.5, 1.0, 0.02, 0.4
YOUNG = SHEAR * (3.0 * LAME + 2.0 * SHEAR) / (LAME + SHEAR)
POISSON = 0.5 * LAME / (LAME + SHEAR)
TENSION = np.linspace(0.0, 0.05, 6)[1:]
INTEGRATORS = ["usavg", "musl", "usl", "usf"]


def material(d: int, hardening: float = HARDENING) -> J2Plasticity:
    return J2Plasticity(1.0, LAME, SHEAR, YIELD, hardening, d)


class Point:
    """A material point on a path of strains."""

    def __init__(self, law: J2Plasticity) -> None:
        self.law, self.F = law, np.eye(law.dimension)[None]
        self.history = at_rest(law, self.F)

    def strain(self, eps: np.ndarray) -> np.ndarray:
        """Bring the point to a strain, and return its stress."""
        self.F = np.eye(self.law.dimension)[None] + eps
        self.law.update(np.arange(1), 0, 1, self.F, self.history)
        return stress(self.law, self.F, self.history)[0]

    @property
    def alpha(self) -> float:
        """Equivalent plastic strain."""
        return float(self.history[0, -1])


def along(d: int, *entries: tuple[int, int, float]) -> np.ndarray:
    eps = np.zeros((d, d))
    for i, j, value in entries:
        eps[i, j] = value
    return eps


@pytest.mark.parametrize("d", [1, 2, 3])
def test_uniaxial_strain_forth_and_back(d: int) -> None:
    """``tau = (lame + 2 mu) e - 2 mu p``; yield at ``|2 mu e - 3 mu p| = Y + H alpha``.

    The plastic strain is ``p`` along the axis and ``-p/2`` across. It stays while the point
    unloads, and the point yields in compression at the yield stress that it had in tension.
    """
    point, stiff = Point(material(d)), LAME + 2.0 * SHEAR
    denominator = 3.0 * SHEAR + HARDENING
    at_yield = YIELD / (2.0 * SHEAR)
    for e in (0.5 * at_yield, at_yield * (1.0 - 1e-9)):
        np.testing.assert_allclose(point.strain(along(d, (0, 0, e)))[0, 0], stiff * e, rtol=1e-12)
        assert point.alpha == 0.0
    top = 5.0 * at_yield
    for e in np.linspace(1.5 * at_yield, top, 4):
        p = (2.0 * SHEAR * e - YIELD) / denominator
        found = point.strain(along(d, (0, 0, e)))
        np.testing.assert_allclose(found[0, 0], stiff * e - 2.0 * SHEAR * p, rtol=1e-12)
        np.testing.assert_allclose(point.alpha, p, rtol=1e-12)
        if d > 1:
            np.testing.assert_allclose(found[1, 1], LAME * e + SHEAR * p, rtol=1e-12)
    p = (2.0 * SHEAR * top - YIELD) / denominator
    elastic_range = 2.0 * (YIELD + HARDENING * p) / (2.0 * SHEAR)
    for e in (top - 0.5 * elastic_range, top - elastic_range * (1.0 - 1e-9)):
        found = point.strain(along(d, (0, 0, e)))[0, 0]
        np.testing.assert_allclose(found, stiff * e - 2.0 * SHEAR * p, rtol=1e-12)
        np.testing.assert_allclose(point.alpha, p, rtol=1e-12)
    back = 2.0 * SHEAR * elastic_range / denominator  # of plastic strain, after twice the range
    found = point.strain(along(d, (0, 0, top - 2.0 * elastic_range)))[0, 0]
    expected = stiff * (top - 2.0 * elastic_range) - 2.0 * SHEAR * (p - back)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    np.testing.assert_allclose(point.alpha, p + back, rtol=1e-11)
    np.testing.assert_allclose(point.history[0, :3], (p - back) * np.array([1, -0.5, -0.5]))


@pytest.mark.parametrize(("d", "i", "j"), [(2, 0, 1), (3, 0, 1), (3, 1, 2), (3, 0, 2)])
def test_simple_shear(d: int, i: int, j: int) -> None:
    """Yield at ``Y / sqrt(3)``, then ``dtau/dgamma = mu H / (3 mu + H)``."""
    point, at_yield = Point(material(d)), YIELD / 3**0.5 / SHEAR
    for gamma in at_yield * np.array([0.7, 1.0 - 1e-9, 2.0, 7.0]):
        slip = max(SHEAR * gamma - YIELD / 3**0.5, 0.0) / (SHEAR + HARDENING / 3.0)
        found = point.strain(along(d, (i, j, gamma)))
        expected = along(d, (i, j, SHEAR * (gamma - slip)))
        np.testing.assert_allclose(found, expected + expected.T, atol=1e-15)
        np.testing.assert_allclose(point.alpha, slip / 3**0.5, atol=1e-15)
    column = 3 + [(1, 2), (0, 2), (0, 1)].index((i, j)) if d == 3 else 3
    np.testing.assert_allclose(point.history[0, column], slip, rtol=1e-12)


def test_uniaxial_stress() -> None:
    """A bar yields at Y; then its stress is ``Y + H alpha`` at the strain ``tau / E + alpha``."""
    point = Point(material(3))
    for alpha in (0.0, 0.01, 0.03):
        pull = YIELD + HARDENING * alpha
        across = -POISSON * pull / YOUNG - 0.5 * alpha
        eps = along(3, (0, 0, pull / YOUNG + alpha), (1, 1, across), (2, 2, across))
        np.testing.assert_allclose(point.strain(eps), along(3, (0, 0, pull)), atol=1e-15)
        np.testing.assert_allclose(point.alpha, alpha, atol=1e-15)


def test_plane_strain_tension_with_a_free_side() -> None:
    """Yield begins at ``Y / sqrt(1 - nu + nu^2)``, and ideal plasticity ends at ``2 Y / sqrt(3)``.

    The side is free, so tau_yy is zero; tau_zz holds the plane.
    """
    modulus = YOUNG / (1.0 - POISSON**2)
    first = YIELD / (1.0 - POISSON + POISSON**2) ** 0.5
    point = Point(material(2, hardening=0.0))
    across = -POISSON / (1.0 - POISSON)
    for share in (1.0 - 1e-9, 1.0 + 1e-3):
        e = share * first / modulus
        found = point.strain(along(2, (0, 0, e), (1, 1, across * e)))
        np.testing.assert_allclose(found, along(2, (0, 0, share * first)), atol=1e-3 * first)
        assert (point.alpha > 0.0) == (share > 1.0)
    side, e = across * e, float(e)
    for _ in range(400):
        e += 0.2 * first / modulus
        start = point.history.copy()

        def free(side: float, e: float = e, start: np.ndarray = start) -> float:
            point.history[:] = start
            return float(point.strain(along(2, (0, 0, e), (1, 1, side)))[1, 1])

        for _ in range(60):  # fixed-point steps with the elastic stiffness
            side -= free(side) / (LAME + 2.0 * SHEAR)
    final = point.strain(along(2, (0, 0, e), (1, 1, side)))
    np.testing.assert_allclose(final, along(2, (0, 0, 2.0 * YIELD / 3**0.5)), atol=1e-4 * YIELD)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_stress_is_the_slope_of_the_stored_energy(d: int) -> None:
    """At fixed history variables."""
    law, F, step = plastic(d), gradients(d), 1e-5
    history = 0.1 * np.random.default_rng(2).uniform(-1, 1, (len(F), history_size(law)))
    expected = np.empty_like(F)
    for i in range(d):
        for j in range(d):
            change = along(d, (i, j, step))
            ahead, behind = (energy(law, F + sign * change, history) for sign in (1, -1))
            expected[:, i, j] = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(stress(law, F, history), expected, atol=1e-9)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_update_returns_to_the_yield_surface_and_stays(d: int) -> None:
    """The plastic strain has no trace, and an update without strain changes nothing."""
    law, F = plastic(d), gradients(d, 50)
    history, everything = at_rest(law, F), (np.arange(50), 0, 50)
    law.update(*everything, F, history)
    assert np.count_nonzero(history[:, -1]) > 40
    np.testing.assert_allclose(history[:, :3].sum(axis=1), 0.0, atol=1e-15)
    again = history.copy()
    law.update(*everything, F, again)
    np.testing.assert_allclose(again, history, atol=1e-15)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_update_writes_only_the_points_asked_for(d: int) -> None:
    law, F, order = plastic(d), gradients(d, 9), np.array([8, 2, 5, 0, 7])
    some, every = at_rest(law, F), at_rest(law, F)
    law.update(order, 1, 4, F, some)
    law.update(np.arange(9), 0, 9, F, every)
    asked = np.isin(np.arange(9), [2, 5, 0])
    np.testing.assert_array_equal(some[asked], every[asked])
    assert not some[~asked].any()
    lost = np.full(9, 99.0)
    law.dissipation(order, 1, 4, every, lost)
    np.testing.assert_allclose(lost[asked], law.yield_stress * every[asked, -1])
    assert (lost[~asked] == 99.0).all()


def test_work_on_a_closed_path_of_strains_is_stored_or_dissipated() -> None:
    """Trapezoidal work of the stress; the error is of second order in the increments."""

    def missing(steps: int) -> float:
        point, work, eps = Point(material(3)), 0.0, np.zeros((3, 3))
        tau = np.zeros((3, 3))
        for angle in np.linspace(0.0, 2.0 * np.pi, steps + 1)[1:]:
            s, c = 0.04 * np.sin(angle), 0.04 * (1.0 - np.cos(angle))
            new = along(3, (0, 0, s), (1, 1, -0.3 * c), (0, 1, c), (1, 2, 0.5 * s))
            new = 0.5 * (new + new.T)
            after = point.strain(new)
            work += 0.5 * float(np.sum((tau + after) * (new - eps)))
            eps, tau = new, after
        lost = np.empty(1)
        point.law.dissipation(np.arange(1), 0, 1, point.history, lost)
        stored = energy(point.law, point.F, point.history)
        assert lost[0] > 0.3 * work
        return abs(work - float(stored[0] + lost[0])) / work

    coarse, fine = missing(100), missing(200)
    assert coarse < 1e-3
    assert fine < 0.35 * coarse


def bar(integrator: str, cells: int, dt: float, **conditions: object) -> Solver:
    """A bar along x in uniaxial strain, in one dimension."""
    law = material(1)
    mesh = Mesh(Hierarchy((0.0,), 1.0, (cells,), (False,)))
    points = fill(mesh, 2, law.density, history_size(law))
    return Solver(
        mesh, points, law, Method(integrator, configuration="reference"), dt, **conditions
    )  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("integrator", "tolerance", "decrease"),
    [("usavg", 2e-5, 3.0), ("musl", 2e-5, 3.0), ("usl", 4e-3, 1.8), ("usf", 4e-3, 1.8)],
)
def test_energy_balance_of_a_bar_that_yields(
    integrator: str, tolerance: float, decrease: float
) -> None:
    """Kinetic, stored and dissipated energy add up to the work of the load.

    The imbalance is of second order in the time step for USAVG and MUSL, and of first order for USL
    and USF.
    """
    hold = PrescribedVelocity(0, 0, 0, lambda _: 0.0)
    pull = Traction(0, 1, (3.0 * YIELD,), lambda time: min(time / 20.0, 1.0))

    def missing(dt: float) -> float:
        solver, steps = bar(integrator, 24, dt, conditions=[pull, hold]), round(80.0 / dt)
        for _ in range(steps):
            solver.step()
        kinetic, stored = solver.energies()[:2]
        dissipated = solver.dissipation()
        assert dissipated > 0.1 * solver.work_now
        return float(abs(kinetic + stored + dissipated - solver.work_now) / solver.work_now)

    coarse, fine = missing(0.1), missing(0.05)
    assert coarse < tolerance
    assert fine < coarse / decrease


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_queries_do_not_change_the_run(integrator: str) -> None:
    """Energies, stress and dissipation leave the history variables as they are."""
    hold, pull = (
        PrescribedVelocity(0, 0, 0, lambda _: 0.0),
        Traction(0, 1, (3.0 * YIELD,), lambda _: 1.0),
    )
    asked, quiet = (bar(integrator, 16, 0.2, conditions=[pull, hold]) for _ in range(2))
    for _ in range(100):
        asked.step()
        quiet.step()
        before = asked.points.history.copy()
        asked.energies(exact=False)
        asked.body.stress()
        asked.dissipation()
        np.testing.assert_array_equal(asked.points.history, before)
    assert quiet.points.history.any()
    np.testing.assert_array_equal(asked.points.history, quiet.points.history)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_history_follows_the_deformation(integrator: str) -> None:
    """After every step the stress of every point is within the yield surface."""
    push = PrescribedVelocity(0, 0, 0, lambda _: 0.05)
    solver = bar(integrator, 16, 0.2, conditions=[push])
    for _ in range(60):
        solver.step()
        p = solver.points
        deviator = np.abs(2.0 * SHEAR * (p.F[:, 0, 0] - 1.0) - 3.0 * SHEAR * p.history[:, 0])
        assert (deviator <= (YIELD + HARDENING * p.history[:, -1]) * (1.0 + 1e-12)).all()
    assert p.history.any()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_elastic_precursor_and_plastic_wave(integrator: str) -> None:
    """A plate that is pushed at its face sends out two waves (Wood, J. Appl. Mech. 19 (1952) 521).

    The elastic precursor has the speed ``sqrt((K + 4 mu / 3) / rho)`` and the stress of the
    elastic limit, ``(lame + 2 mu) Y / (2 mu)``. The plastic wave follows with
    ``sqrt((K + 4 mu H / (3 (3 mu + H))) / rho)``, the slope of the stress in uniaxial strain.
    """
    bulk = LAME + 2.0 * SHEAR / 3.0
    fast = (bulk + 4.0 / 3.0 * SHEAR) ** 0.5
    slow = (bulk + 4.0 / 3.0 * SHEAR * HARDENING / (3.0 * SHEAR + HARDENING)) ** 0.5
    limit = (LAME + 2.0 * SHEAR) * YIELD / (2.0 * SHEAR)
    first = limit / fast  # velocity behind the precursor
    speed, cells, dt = 4.0 * first, 400, 0.2
    rise = 60.0
    begin = rise * first / speed  # of the plastic wave
    push = PrescribedVelocity(0, 0, 0, lambda time: speed * min(time / rise, 1.0))
    solver = bar(integrator, cells, dt, conditions=[push])
    for _ in range(round(170.0 / dt)):
        solver.step()
    order = np.argsort(solver.points.x[:, 0])
    X, v = solver.points.reference[order, 0], solver.points.v[order, 0]
    tau = solver.body.stress()[order, 0, 0]

    def front(velocity: float, sent: float) -> float:
        """Speed at which a velocity, reached at a time at the plate, has travelled."""
        here = np.flatnonzero(v > velocity)[-1]
        return float(X[here] / (solver.time - sent))

    half = 0.5 * first
    assert front(half, half / speed * rise) == pytest.approx(fast, rel=0.01)
    middle = 0.5 * (first + speed)
    assert front(middle, middle / speed * rise) == pytest.approx(slow, rel=0.01)
    now = solver.time
    between = (slow * (now - begin) + 8.0 < X) & (fast * (now - begin) - 8.0 > X)
    np.testing.assert_allclose(-tau[between].mean(), limit, rtol=0.01)
    behind = (X > 20.0) & (slow * (now - rise) - 20.0 > X)
    expected = limit + slow * (speed - first)
    np.testing.assert_allclose(-tau[behind].mean(), expected, rtol=0.01)
    assert between.sum() > 20
    assert behind.sum() > 20
