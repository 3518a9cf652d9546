"""Cracks: two velocity fields, so that nothing crosses the line."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.setup import make_solver


def cracked(build, *cracks):
    continuum = {
        "material": {"from": "case", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0},
        "cracks": list(cracks),
        "xpic": {"every": 0},
    }
    pull = {"condition": "traction", "ramp": 2.0}
    return build(
        domain={"box": [[0.0, 24.0], [0.0, 24.0]]},
        md={"region": [[0.0, 24.0], [0.0, 24.0]], "input": "none.in"},
        continuum=continuum,
        boundary={
            "top": {**pull, "value": [0.0, 1e-3]},
            "bottom": {**pull, "value": [0.0, -1e-3]},
        },
    )


def test_a_crack_through_the_whole_body_parts_it(build):
    solver = make_solver(cracked(build, {"from": [0.0, 11.5], "to": [24.0, 11.5]}))
    for _ in range(60):
        solver.step()
    upper = solver.points.reference[:, 1] > 11.5
    impulse = 24.0 * 1e-3 * (solver.time - 1.0)  # the ramp takes half of its two units away
    momentum = solver.points.mass[upper] @ solver.points.v[upper]
    assert momentum[1] == pytest.approx(impulse, rel=2e-2)
    assert abs(momentum[0]) < 1e-12


def test_an_edge_crack_opens_and_its_faces_carry_no_stress(build):
    solver = make_solver(cracked(build, {"from": [0.0, 11.5], "to": [12.0, 11.5]}))
    while solver.time < 30.0:
        solver.step()
    p = solver.points
    stress = solver.stress()
    X, Y = p.reference.T
    upper = (X < 6.0) & (Y > 11.5) & (Y < 12.5)
    lower = (X < 6.0) & (Y < 11.5) & (Y > 10.5)
    ahead = (X > 12.0) & (X < 14.0) & (np.abs(Y - 11.5) < 1.0)
    opening = (p.x - p.reference)[upper, 1].mean() - (p.x - p.reference)[lower, 1].mean()
    assert opening > 5e-3
    assert np.abs(stress[upper | lower, 1, 1]).mean() < 0.1 * stress[ahead, 1, 1].mean()


def half_opening(solver):
    """Displacement of the upper face of a crack along y = 12, near its tip, at t = 20."""
    while solver.time < 20.0:
        solver.step()
    X, Y = solver.points.reference.T
    face = (X > 10.0) & (X < 11.0) & (Y > 12.0) & (Y < 12.5)
    return (solver.points.x - solver.points.reference)[face, 1].mean()


def test_a_node_on_which_a_crack_ends_stays_whole(build):
    """So a tip on a node counts as one between that node and the last."""
    short, exact, long = (
        half_opening(make_solver(cracked(build, {"from": [0.0, 12.0], "to": [x, 12.0]})))
        for x in (11.5, 12.0, 12.5)
    )
    assert exact == pytest.approx(short, rel=1e-12)
    assert long > 1.05 * exact


def test_a_crack_in_two_pieces_is_one_crack(build):
    """The node at which the pieces join is split, as it lies inside the crack."""
    whole = cracked(build, {"from": [0.0, 12.0], "to": [11.5, 12.0]})
    pieces = ({"from": [0.0, 12.0], "to": [6.0, 12.0]}, {"from": [6.0, 12.0], "to": [11.5, 12.0]})
    assert half_opening(make_solver(cracked(build, *pieces))) == pytest.approx(
        half_opening(make_solver(whole)), rel=1e-12
    )


def test_without_load_a_crack_changes_nothing(build):
    """Nodal mass is shared between the fields of a node, none is lost."""
    solver = make_solver(cracked(build, {"from": [0.0, 11.5], "to": [12.0, 11.5]}))
    assert solver.M.sum() == pytest.approx(24.0 * 24.0, rel=1e-13)
    assert solver.M[solver.mesh.twin[solver.mesh.twin >= 0]].sum() > 0.0


def test_an_oblique_edge_crack_keeps_its_line_beyond_the_face(build):
    solver = make_solver(cracked(build, {"from": [0.0, 4.0], "to": [12.0, 16.0]}))
    x0, y0, x1, y1 = solver.cracks.segments[0]
    assert (x1, y1) == pytest.approx((12.0, 16.0), abs=1e-5)
    assert x0 < -2.0
    assert y0 - x0 == pytest.approx(4.0)
