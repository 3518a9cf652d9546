"""Cracks: two velocity fields, so that nothing crosses the line; contact of their faces.

Density 1, longitudinal wave speed 1, shear wave speed ``sqrt(1/3)``.
"""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.fracture.contact import OPEN
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import join, take
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.services.gimp.ranks import on_ranks

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
FREE, PERIODIC, TUBE = (False, False), (True, False), (True, False, True)


def body(hierarchy, *lines, comm=None, friction=None, integrator="usavg", xpic=0, **conditions):
    cracks = make_cracks(lines, hierarchy, friction)
    mesh = Mesh(hierarchy, comm, cracks=cracks)
    method = Method(integrator=integrator, xpic_every=xpic)
    dt = 0.4 / 2**hierarchy.top
    return Solver(mesh, fill(mesh, 2, 1.0), LAW, method, dt, cracks=cracks, **conditions)


def pull(axis, side, dim=2):
    sign = 1.0 if side else -1.0
    value = tuple(sign * 1e-3 if d == axis else 2e-4 for d in range(dim))
    return Traction(axis, side, value, lambda time: min(time / 2.0, 1.0))


RIM = ((((16, 48), (16, 32)),),)
BAND = ((((24, 40), (0, 48)),),)


@pytest.mark.parametrize(
    ("hierarchy", "lines", "integrator"),
    [
        (Hierarchy((0.0, 0.0), 1.0, (24, 24), FREE), [((0, 11.5), (24, 11.5))], "usavg"),
        (Hierarchy((0.0, 0.0), 1.0, (24, 24), PERIODIC), [((0, 12), (24, 12))], "musl"),
        (Hierarchy((0.0, 0.0), 1.0, (24, 24), FREE), [((0, 4), (24, 17))], "usavg"),
        (
            Hierarchy((0.0, 0.0), 1.0, (24, 24), FREE),
            [((0, 8), (11.3, 12.2)), ((11.3, 12.2), (24, 10))],
            "usavg",
        ),
        (Hierarchy((0.0, 0.0), 1.0, (32, 24), FREE, RIM), [((0, 11.6), (32, 12.3))], "usavg"),
        (Hierarchy((0.0, 0.0), 1.0, (32, 24), PERIODIC, BAND), [((0, 12), (32, 12))], "musl"),
        (
            Hierarchy((0.0, 0.0, 0.0), 1.0, (8, 8, 8), (False,) * 3),
            [((0, 3.2, 0), (0, 4.2, 8), (8, 0.4, 0))],
            "usavg",
        ),
        (
            Hierarchy(
                (0.0, 0.0, 0.0),
                1.0,
                (6, 14, 6),
                TUBE,
                ((((0, 12), (0, 14), (0, 12)),),),
            ),
            [((0, 6.6, 0), (0, 6.6, 6), (6, 0, 0))],
            "musl",
        ),
    ],
    ids=[
        "edges",
        "periodic",
        "oblique",
        "kinked",
        "levels",
        "levels periodic",
        "3-D",
        "3-D levels",
    ],
)
def test_a_crack_through_the_whole_body_parts_it(hierarchy, lines, integrator):
    """What lies below the crack feels nothing at all of the pull on top."""
    dim = hierarchy.dim
    loads = [pull(1, 1, dim)]
    solver = body(hierarchy, *lines, conditions=loads, integrator=integrator, xpic=3)
    for _ in range(20 * 2**hierarchy.top):
        solver.step()
    points = solver.points
    line = np.array([[line[0][0], line[0][1]] for line in lines] + [lines[-1][1][:2]], dtype=float)
    if dim == 3:
        (x0, y0, z0), (_, y1, z1), (x2, y2, _) = lines[0]
        X = points.reference
        height = X[:, 1] - y0 - (y1 - y0) * (X[:, 2] - z0) / (z1 - z0) - y2 * (X[:, 0] - x0) / x2
    else:
        height = points.reference[:, 1] - np.interp(points.reference[:, 0], *line.T)
    assert (points.v[height < 0.0] == 0.0).all()
    area = np.prod([hierarchy.cells[axis] for axis in range(dim) if axis != 1])
    impulse = area * 1e-3 * (solver.time - 1.0)  # the ramp takes half of its two units away
    upper = height > 0.0
    assert points.mass[upper] @ points.v[upper, 1] == pytest.approx(impulse, rel=3e-2)


def test_an_edge_crack_opens_and_its_faces_carry_no_stress():
    h = Hierarchy((0.0, 0.0), 1.0, (24, 24), FREE)
    solver = body(h, ((0, 11.5), (12, 11.5)), conditions=[pull(1, 1), pull(1, 0)])
    while solver.time < 30.0:
        solver.step()
    p = solver.points
    stress = solver.body.stress()
    X, Y = p.reference.T
    upper = (X < 6.0) & (Y > 11.5) & (Y < 12.5)
    lower = (X < 6.0) & (Y < 11.5) & (Y > 10.5)
    ahead = (X > 12.0) & (X < 14.0) & (np.abs(Y - 11.5) < 1.0)
    u = p.x - p.reference
    assert u[upper, 1].mean() - u[lower, 1].mean() > 5e-3
    assert np.abs(stress[upper | lower, 1, 1]).mean() < 0.1 * stress[ahead, 1, 1].mean()


def half_opening(*lines):
    """Displacement of the upper face of a crack along y = 12, near its tip, at t = 20."""
    h = Hierarchy((0.0, 0.0), 1.0, (24, 24), FREE)
    solver = body(h, *lines, conditions=[pull(1, 1), pull(1, 0)])
    while solver.time < 20.0:
        solver.step()
    X, Y = solver.points.reference.T
    face = (X > 10.0) & (X < 11.0) & (Y > 12.0) & (Y < 12.5)
    return (solver.points.x - solver.points.reference)[face, 1].mean()


def test_a_node_on_which_a_crack_ends_stays_whole():
    """So a tip on a node counts as one between that node and the last."""
    short, exact, long = (half_opening(((0, 12), (x, 12))) for x in (11.5, 12.0, 12.5))
    assert exact == pytest.approx(short, rel=1e-12)
    assert long > 1.05 * exact


def test_a_crack_in_two_pieces_is_one_crack():
    """The node at which the pieces join is split, as it lies inside the crack."""
    whole = half_opening(((0, 12), (11.5, 12)))
    pieces = half_opening(((0, 12), (6, 12)), ((6, 12), (11.5, 12)))
    assert pieces == pytest.approx(whole, rel=1e-12)


def test_nodal_mass_is_shared_between_the_fields_of_a_node():
    h = Hierarchy((0.0, 0.0), 1.0, (32, 24), FREE, RIM)
    solver = body(h, ((0, 11.6), (20, 12.0)))
    assert solver.M[solver.mesh.basis].sum() == pytest.approx(32.0 * 24.0, rel=1e-13)
    assert solver.M[solver.mesh.twin[solver.mesh.twin >= 0]].sum() > 1.0


# --- contact -------------------------------------------------------------------------------

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
