"""Contact of crack faces: what it lets pass, and what friction takes."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.fracture.contact import OPEN
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import join, take
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.services.gimp.fracture.cracked import FREE, LAW, RIM, body
from tests.services.gimp.ranks import on_ranks

BAR = Hierarchy((0.0, 0.0), 1.0, (64, 4), (True, True))
BAR_LEVELS = Hierarchy((0.0, 0.0), 1.0, (64, 4), (True, True), ((((48, 80), (0, 8)),),))
BAR_3D = Hierarchy((0.0, 0.0, 0.0), 1.0, (64, 2, 2), (True, True, True))
CUT = ((32.0, 0.0), (32.0, 4.0))
CUT_3D = ((32.0, 0.0, 0.0), (32.0, 2.0, 0.0), (0.0, 0.0, 2.0))
AMPLITUDE, WIDTH = 1e-4, 3.0


def pulse(hierarchy, lines, component, pressure=0.0, **options):
    """A pulse that travels along x, in a body under pressure."""
    solver = body(hierarchy, *lines, **options)
    p = solver.points
    shape = AMPLITUDE * np.exp(-0.5 * ((p.reference[:, 0] - 16.0) / WIDTH) ** 2)
    speed = 1.0 if component == 0 else np.sqrt(LAW.shear)
    p.v[:, component] = shape
    p.F[:, component, 0] -= shape / speed
    p.F[:, 0, 0] -= pressure
    p.x[:, 0] -= pressure * (p.reference[:, 0] - 32.0)
    return solver


def run(solver, time):
    while solver.time < time - 1e-9:
        solver.step()
    return solver


@pytest.mark.parametrize("integrator", ["usavg", "musl", "usl", "usf"])
@pytest.mark.parametrize(
    ("hierarchy", "cut"),
    [(BAR, CUT), (BAR_LEVELS, CUT), (BAR_3D, CUT_3D)],
    ids=["one level", "two levels", "3-D"],
)
def test_a_crack_that_sticks_is_not_there(hierarchy, cut, integrator):
    options = {"component": 1, "pressure": 1e-3, "integrator": integrator}
    stuck = run(pulse(hierarchy, [cut], friction=1.0, **options), 32.0)
    whole = run(pulse(hierarchy, [], **options), 32.0)
    a, b = np.argsort(stuck.points.id), np.argsort(whole.points.id)
    assert np.abs(stuck.points.v[a] - whole.points.v[b]).max() < 1e-6 * AMPLITUDE
    assert stuck.contact.dissipated == 0.0


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
@pytest.mark.parametrize("hierarchy", [BAR, BAR_LEVELS], ids=["one level", "two levels"])
def test_compression_crosses_a_closed_crack_and_tension_does_not(hierarchy, integrator):
    """Ripples of a percent or so follow a pulse on a grid; their tension stays behind."""
    options = {"component": 0, "integrator": integrator, "friction": 0.0}
    solver = pulse(hierarchy, [CUT], **options)
    before = solver.energies()
    run(solver, 32.0)
    p, after = solver.points, solver.energies()
    whole = run(pulse(hierarchy, [], 0, integrator=integrator), 32.0)
    a, b = np.argsort(p.id), np.argsort(whole.points.id)
    assert np.abs(p.v[a] - whole.points.v[b]).max() < 0.04 * AMPLITUDE
    assert after[:2].sum() == pytest.approx(before[:2].sum(), rel=1e-4)
    # nodes that a point has just begun to touch are too light to take its force (MASS_FLOOR)
    assert after[3:] == pytest.approx(before[3:], rel=1e-8, abs=1e-17)

    solver = pulse(hierarchy, [CUT], **options)
    solver.points.F[:] = 2.0 * np.eye(2) - solver.points.F
    solver.points.v *= -1.0
    run(solver, 32.0)
    right = solver.points.reference[:, 0] > 32.0
    assert np.abs(solver.points.v[right]).max() < 0.04 * AMPLITUDE
    assert solver.points.v[~right, 0].min() < -0.9 * AMPLITUDE  # reflected as compression


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
@pytest.mark.parametrize("hierarchy", [BAR, BAR_LEVELS], ids=["one level", "two levels"])
def test_friction_passes_a_shear_pulse_up_to_its_limit(hierarchy, integrator):
    """Exact: the crack passes min(tau, mu p); sliding takes mu p times 2 (tau - mu p) / (rho c)."""
    friction, pressure = 0.02, 1e-3
    options = {"component": 1, "pressure": pressure, "integrator": integrator}
    solver = pulse(hierarchy, [CUT], friction=friction, **options)
    before = solver.energies()
    run(solver, 48.0)
    c = np.sqrt(LAW.shear)
    most = friction * pressure / c  # speed of the pulse that just sticks
    t = np.linspace(-30.0, 30.0, 60001)
    incoming = AMPLITUDE * np.exp(-0.5 * (c * t / WIDTH) ** 2)
    slip = 2.0 * np.maximum(incoming - most, 0.0)
    exact = 4.0 * friction * pressure * slip.sum() * (t[1] - t[0])
    assert solver.contact.dissipated == pytest.approx(exact, rel=0.04)

    p = solver.points
    crossed = p.reference[:, 0] > 32.0
    assert p.mass[crossed] @ p.v[crossed, 1] == pytest.approx(
        4.0 * c * np.minimum(incoming, most).sum() * (t[1] - t[0]), rel=0.04
    )
    if integrator == "usavg" and hierarchy is BAR:
        whole = pulse(hierarchy, [], **options)
        drift = -whole.energies()[:2].sum() + run(whole, 48.0).energies()[:2].sum()
        lost = before[:2].sum() - solver.energies()[:2].sum() + drift
        assert solver.contact.dissipated == pytest.approx(lost, rel=5e-3)


def test_smooth_faces_pass_no_shear():
    solver = run(pulse(BAR, [CUT], 1, pressure=1e-3, friction=0.0), 36.0)
    right = solver.points.reference[:, 0] > 32.0
    assert np.abs(solver.points.v[right, 1]).max() < 0.01 * AMPLITUDE
    assert solver.contact.dissipated == 0.0


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_two_bars_collide_and_part_again(integrator):
    """Equal bars exchange their velocities, ``2 L / c`` after they meet."""
    h = Hierarchy((0.0, 0.0), 1.0, (32, 2), (False, True))
    solver = body(h, ((16, 0), (16, 2)), friction=0.3, integrator=integrator, xpic=10)
    p = solver.points
    side = np.sign(p.reference[:, 0] - 16.0)
    p.v[:, 0] = -1e-3 * side
    energy = solver.energies()[:2].sum()
    run(solver, 60.0)
    p = solver.points
    side = np.sign(p.reference[:, 0] - 16.0)
    assert p.mass @ (p.v[:, 0] * side) == pytest.approx(64.0 * 1e-3, rel=0.08)
    assert abs(p.mass @ p.v[:, 0]) < 1e-15
    assert solver.energies()[:2].sum() <= energy
    assert (solver.contact.states == OPEN).all()


def two_blocks(apart, speed, friction, integrator="usavg"):
    """Blocks above and below y = 12, moved apart and sent towards each other."""
    h = Hierarchy((0.0, 0.0), 1.0, (4, 24), (True, False))
    cracks = make_cracks([((0, 12), (4, 12))], h, friction)
    mesh = Mesh(h, cracks=cracks)
    points = fill(mesh, 2, 1.0)
    points = take(points, np.abs(points.reference[:, 1] - 12.0) < 8.0)
    side = np.sign(points.reference[:, 1] - 12.0)
    points.x[:, 1] += 0.5 * apart * side
    points.v[:, 1] -= 0.5 * speed * side
    return Solver(mesh, points, LAW, Method(integrator, xpic_every=0), 0.4, cracks=cracks)


def test_faces_may_part_by_cells():
    """Rigid blocks fly apart; before they are a cell apart they share nodes, yet feel nothing."""
    solver = two_blocks(0.0, -0.1, 0.3)
    run(solver, 36.0)
    p = solver.points
    side = np.sign(p.reference[:, 1] - 12.0)
    assert p.x[:, 1] - p.reference[:, 1] == pytest.approx(0.05 * side * solver.time, abs=1e-12)
    assert np.abs(p.F - np.eye(2)).max() < 1e-12


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_faces_meet_when_their_gap_is_closed_not_before(integrator):
    """Exact: stress ``rho c v`` between waves that leave the faces when these have met."""
    gap, speed = 0.8, 0.02
    solver = two_blocks(gap, speed, 0.3, integrator)
    run(solver, gap / speed - 0.8)
    assert np.abs(solver.points.v[:, 1]) == pytest.approx(0.5 * speed, rel=1e-10)
    momentum = []
    for time in (2.0, 6.0):
        run(solver, gap / speed + time)
        p = solver.points
        height = p.reference[:, 1] - 12.0
        momentum.append(p.mass[height > 0.0] @ p.v[height > 0.0, 1])
    pressure = (momentum[1] - momentum[0]) / 4.0 / 4.0
    assert pressure == pytest.approx(0.5 * speed, rel=0.03)
    assert np.abs(p.v[np.abs(height) > 7.5, 1]) == pytest.approx(0.5 * speed, rel=0.1)


def oblique(comm):
    """Shear pulse over an oblique crack under pressure, through levels."""
    h = Hierarchy((0.0, 0.0), 1.0, (32, 24), FREE, RIM)
    lines = [((0, 9.6), (27.3, 13.1))]
    conditions = {"conditions": [Traction(1, 1, (4e-4, -1e-3), lambda t: min(t / 3.0, 1.0))]}
    return run(body(h, *lines, comm=comm, friction=0.2, xpic=10, **conditions), 28.0)


def compare_ranks():
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    solver = oblique(world)
    points = join(world.allgather(solver.points))
    lost = world.allreduce(solver.contact.dissipated)
    if world.rank == 0:
        alone = oblique(None)
        a, b = np.argsort(points.id), np.argsort(alone.points.id)
        assert lost > 0.0
        assert lost == pytest.approx(alone.contact.dissipated, rel=1e-9)
        assert np.abs(points.v[a] - alone.points.v[b]).max() < 1e-11 * np.abs(points.v).max()
        assert np.abs(points.F[a] - alone.points.F[b]).max() < 1e-14


def test_ranks_agree():
    on_ranks(2, __file__, "compare_ranks")
