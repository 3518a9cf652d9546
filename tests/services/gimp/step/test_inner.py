"""Momentum and energy between points that follow another code and the rest of the body."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.groups import INNER
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.physics.gimp.bodies import UNIT
from tests.services.gimp.dense import disturb, hooke, weights_of


def body(
    integrator: str = "musl",
    cells: tuple[int, int] = (6, 4),
    dt: float = 0.3,
    rim: float = 0.0,
    initial=disturb,
    periodic: tuple[bool, bool] = (False, False),
) -> Solver:
    """A body whose left half follows another code; the rim ends at ``x = rim``."""
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, cells, periodic))
    points = fill(mesh, 2, UNIT.density)
    initial(points)
    x = points.reference[:, 0]
    method = Method(integrator, xpic_every=0)
    groups = {"inner": x < 0.5 * cells[0], "rim": x < rim if rim else None}
    return Solver(mesh, points, UNIT, method, dt, **groups)


@pytest.mark.parametrize("rim", [0.0, 0.5], ids=["to the face", "with a rim"])
def test_the_impulse_is_what_moves_the_rest(rim) -> None:
    """``J_i = (M_i - m_i) dV_i - J_i(rest)``; nodes that the rim touches have no internal force."""
    solver = body(rim=rim)
    S, G = weights_of(solver)
    p, inner = solver.points, solver.body.mask(INNER)
    stress = hooke(p.F, UNIT.lame, UNIT.shear)
    rest = S[~inner].T @ p.mass[~inner]
    pulled = -0.15 * np.einsum(
        "p,pij,pnj->ni", p.volume[~inner], stress[~inner], G[~inner]
    )  # the first kick is half a step
    solver.start_step()
    impulse = solver.stages.inner.impulse
    expected = rest[:, None] * solver.nodes.dV - pulled
    np.testing.assert_allclose(impulse, expected, atol=1e-15)
    assert np.abs(impulse).max() > 1e-3
    if rim:
        touched = S[p.reference[:, 0] < rim].any(axis=0)
        np.testing.assert_array_equal(solver.nodes.dV[touched], 0.0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_impulse_is_the_momentum_that_the_rest_gains(integrator) -> None:
    """Stress that balances itself at every node leaves only what the inner points exchange."""
    solver = body(integrator)
    for _ in range(3):
        rest = ~solver.body.mask(INNER)
        before = solver.points.mass[rest] @ solver.points.v[rest]
        solver.step()
        after = solver.points.mass[rest] @ solver.points.v[rest]
        given = solver.stages.inner.impulse.sum(axis=0)
        np.testing.assert_allclose(after - before, given, atol=1e-15)
        assert np.abs(given).max() > 1e-4


def test_inner_points_are_left_where_they_are() -> None:
    solver = body("usavg")
    inner = solver.body.mask(INNER)
    before = [getattr(solver.points, name).copy() for name in ("x", "F")]
    solver.step()
    for name, old in zip(("x", "F"), before, strict=True):
        now = getattr(solver.points, name)
        np.testing.assert_array_equal(now[inner], old[inner])
        assert (now[~inner] != old[~inner]).any(axis=tuple(range(1, now.ndim))).all()


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_interface_work_is_the_energy_of_a_wave_that_passes(integrator) -> None:
    """Inner points carry an exact pulse of strain and velocity into the rest: second order."""
    amplitude, errors = 1e-5, []
    for length in (12, 24):  # of the pulse, in cells
        exact = 2.0 * amplitude**2 * 3.0 / 8.0 * length  # energy of the pulse, two cells high

        def pulse(X: np.ndarray, time: float, length: int = length) -> np.ndarray:
            s = (X[:, 0] - time) / length
            return np.where((s > 0.0) & (s < 1.0), amplitude * np.sin(np.pi * s) ** 2, 0.0)

        cells, dt = (3 * length, 2), 0.2
        solver = body(integrator, cells, dt, 0.0, lambda p: None, (False, True))
        while solver.time < 1.6 * length:
            p, inner = solver.points, solver.body.mask(INNER)
            X = p.reference[inner]
            p.v[inner, 0] = pulse(X, solver.clock.velocity_time[0])
            p.F[inner, 0, 0] = 1.0 - pulse(X, solver.time)
            solver.step()
        rest = solver.body.add_group(~solver.body.mask(INNER))
        gained = solver.energies(rest)[:2].sum()
        errors.append([abs(energy / exact - 1.0) for energy in (solver.work.interface, gained)])
    assert max(errors[0]) < 0.08, errors
    assert max(errors[1]) < 0.4 * max(errors[0]), errors
