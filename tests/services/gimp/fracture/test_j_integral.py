"""Energy release rate and stress intensities in a clamped strip, whose values are exact.

A strip of height H with a long crack in its middle, clamped edges: growth by da turns the energy of
a column far ahead, ``W H da``, into that of one far behind, nothing. So ``J = W H`` with
``W = (lame + 2 shear) strain^2 / 2`` for edges moved apart and ``shear strain^2 / 2`` for edges
moved along (Rice, J. Appl. Mech. 35 (1968) 379).
"""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.fracture.j_integral import crack_tip
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic, NeoHookean
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.services.gimp.ranks import on_ranks

LAME, SHEAR, STRAIN = 1.0, 0.5, 1e-3
STIFFNESS = 4.0 * SHEAR * (LAME + SHEAR) / (LAME + 2.0 * SHEAR)
HEIGHT, LENGTH, FRONT = 1.0, 4.5, 0.25


def tip_of(solver, *where, **more):
    """Energy release at a tip in the present state of a solver."""
    return crack_tip(solver.body, solver.V, solver.clock.span, *where, **more)


def at_rest(opening, shearing, cells=16, comm=None, law=LinearElastic, finer=(), dim=2, tip=2.5):
    """The strip at rest; opening and shearing in units of ``STRAIN``."""
    cell = HEIGHT / cells
    deep = () if dim == 2 else (round(FRONT / cell),)
    h = Hierarchy(
        (0.0,) * dim,
        cell,
        (round(LENGTH * cells), cells, *deep),
        (False, False, *(True for _ in deep)),
        finer,
    )
    rest = (0.0,) * (dim - 2)
    line = ((0.0, 0.5, *rest), (tip, 0.5, *rest), *((0.0, 0.0, FRONT) for _ in deep))
    cracks = make_cracks([line], h)
    mesh = Mesh(h, comm, cracks=cracks)
    points = fill(mesh, 2, 1.0)
    points.F[:, 1, 1] += opening * STRAIN
    points.F[:, 0, 1] += shearing * STRAIN
    clamps = [(1, 0), (1, 1), (0, 1)]  # the left face, at the mouth, is free
    driven = [PrescribedVelocity(*face, k, lambda _: 0.0) for face in clamps for k in range(dim)]
    solver = Solver(
        mesh,
        points,
        law(1.0, LAME, SHEAR),
        Method(xpic_every=20, damping=(DampingRegion(rate=3.0),)),
        0.4 * cell / np.sqrt(LAME + 2.0 * SHEAR) / 2**h.top,
        conditions=driven,
        cracks=cracks,
    )
    while solver.time < 8.0 or not solver.clock.synchronous():
        solver.step()
    return solver


def exact(opening, shearing):
    modes = np.array([opening**2 * (LAME + 2.0 * SHEAR), shearing**2 * SHEAR])
    J = 0.5 * STRAIN**2 * HEIGHT * modes
    return J.sum(), np.sqrt(J * STIFFNESS)


TIP, AHEAD = np.array([2.5, 0.5]), np.array([1.0, 0.0])


@pytest.mark.parametrize(("opening", "shearing"), [(1, 0), (0, 1), (1, 1), (1, -2)])
def test_a_clamped_strip(opening, shearing):
    solver = at_rest(opening, shearing)
    J, (K1, K2) = exact(opening, shearing)
    for radius in (0.3, 0.45):
        found = tip_of(solver, TIP, AHEAD, radius)
        assert pytest.approx(J, rel=0.01) == found.J1
        size = np.hypot(K1, K2)
        assert pytest.approx((K1, np.sign(shearing) * K2), abs=0.02 * size) == found.K
        assert pytest.approx(-2.0 * found.K[0] * found.K[1] / STIFFNESS, rel=1e-12) == found.J2


@pytest.mark.long
def test_the_error_falls_with_the_cell_and_the_radius_does_not_matter():
    J, _ = exact(1, 0)
    spread, errors = [], []
    for cells in (8, 32):
        solver = at_rest(1, 0, cells)
        found = [tip_of(solver, TIP, AHEAD, radius).J1 / J for radius in (0.25, 0.35, 0.45)]
        spread.append(max(found) - min(found))
        errors.append(np.abs(np.array(found) - 1.0).max())
    assert spread[1] < 1e-3
    assert errors[1] < 1.5e-3
    assert errors[1] < 0.25 * errors[0]


def test_the_place_of_the_tip_in_its_cell_does_not_matter():
    J, (K1, _) = exact(1, 0)
    solver = at_rest(1, 0, tip=2.53)
    found = tip_of(solver, np.array([2.53, 0.5]), AHEAD, 0.45)
    assert pytest.approx(J, rel=0.01) == found.J1
    assert pytest.approx((K1, 0.0), rel=0.01, abs=1e-3 * K1) == found.K


def test_levels_around_the_tip():
    J, _ = exact(1, 0)
    finer = ((((64, 96), (0, 32)),),)
    solver = at_rest(1, 0, finer=finer)
    assert set(solver.points.level) == {0, 1}
    assert pytest.approx(J, rel=5e-3) == tip_of(solver, TIP, AHEAD, 0.45).J1


def test_a_finite_law_at_small_strain():
    J, _ = exact(1, 0)
    found = tip_of(at_rest(1, 0, law=NeoHookean), TIP, AHEAD, 0.45)
    assert pytest.approx(J, rel=0.015) == found.J1
    assert found.K is None


def test_three_dimensions():
    """The same strip, two cells deep and periodic along the front."""
    J, (K1, _) = exact(1, 0)
    solver = at_rest(1, 0, 8, dim=3)
    tip, ahead = np.array([2.5, 0.5, 0.1]), np.array([1.0, 0.0, 0.0])
    found = tip_of(solver, tip, ahead, 0.4, normal=np.array([0.0, 1.0, 0.0]), front=FRONT)
    assert pytest.approx(J, rel=0.01) == found.J1
    assert found.K[0] == pytest.approx(K1, rel=0.01)
    with pytest.raises(ValueError, match="normal"):
        tip_of(solver, tip, ahead, 0.4)


def struck(time, cells=64):
    """A crack half through a plate, struck by a plane wave of tension; time since it arrived."""
    ramp, c = 6.0, np.sqrt(LAME + 2.0 * SHEAR)
    h = Hierarchy((0.0, 0.0), 64.0 / cells, (cells, cells), (False, False))
    cracks = make_cracks([((0.0, 32.0), (32.0, 32.0))], h)
    mesh = Mesh(h, cracks=cracks)
    solver = Solver(
        mesh,
        fill(mesh, 2, 1.0),
        LinearElastic(1.0, LAME, SHEAR),
        Method(xpic_every=20),
        0.4 * h.cell / c,
        conditions=[
            Traction(1, 1, (0.0, 1e-3), lambda t: min(t / ramp, 1.0)),
            *(PrescribedVelocity(0, side, 0, lambda _: 0.0) for side in (0, 1)),
        ],
        cracks=cracks,
    )
    while solver.time < 32.0 / c + time:
        solver.step()
    since = solver.time - 32.0 / c - (np.arange(600) + 0.5) * ramp / 600
    poisson = 0.5 * LAME / (LAME + SHEAR)
    rise = 2e-3 / (1.0 - poisson) * np.sqrt((1.0 - 2.0 * poisson) * c / np.pi)
    return solver, rise * np.sqrt(np.maximum(since, 0.0)).mean()


def test_a_crack_struck_by_a_wave():
    """Exact until waves return: ``K_I = 2 s / (1 - nu) sqrt((1 - 2 nu) c t / pi)`` (Freund 1990).

    The terms of inertia make the result independent of the radius while waves cross it.
    """
    tip = np.array([32.0, 32.0])
    for time in (12.0, 20.0):
        solver, K1 = struck(time)
        found = [tip_of(solver, tip, AHEAD, radius) for radius in (6.0, 12.0)]
        assert [one.K[0] for one in found] == pytest.approx([K1, K1], rel=0.015)
        assert abs(found[0].K[1]) < 0.02 * K1
        solver.points.dv[:] = 0.0
        solver.points.v[:] = 0.0
        near, far = (tip_of(solver, tip, AHEAD, radius).J1 for radius in (6.0, 12.0))
        assert abs(far - near) > 5.0 * abs(found[1].J1 - found[0].J1)


def across_ranks():
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    a, b = at_rest(1, 1, 8, world), at_rest(1, 1, 8)
    here, alone = tip_of(a, TIP, AHEAD, 0.45), tip_of(b, TIP, AHEAD, 0.45)
    assert pytest.approx(alone.J1, rel=1e-10) == here.J1
    assert pytest.approx(alone.K, rel=1e-9) == here.K


def test_ranks_agree():
    on_ranks(2, __file__, "across_ranks")
