"""Cracks: two velocity fields, so that nothing crosses the line."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.grid.hierarchy import Hierarchy
from tests.services.gimp.fracture.cracked import FREE, RIM, body

PERIODIC, TUBE = (True, False), (True, False, True)
BAND = ((((24, 40), (0, 48)),),)


def pull(axis, side, dim=2):
    sign = 1.0 if side else -1.0
    value = tuple(sign * 1e-3 if d == axis else 2e-4 for d in range(dim))
    return Traction(axis, side, value, lambda time: min(time / 2.0, 1.0))


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
