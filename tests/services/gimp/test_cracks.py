"""Cracks: two velocity fields, so that nothing crosses the line."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.backend import make_solver


def cracked(build, crack):
    continuum = {
        "material": {"from": "case", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0},
        "cracks": [crack],
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
    stress = np.empty_like(p.strain)
    solver.material.stress(p.strain, stress)
    X, Y = p.reference.T
    upper = (X < 6.0) & (Y > 11.5) & (Y < 12.5)
    lower = (X < 6.0) & (Y < 11.5) & (Y > 10.5)
    ahead = (X > 12.0) & (X < 14.0) & (np.abs(Y - 11.5) < 1.0)
    opening = (p.x - p.reference)[upper, 1].mean() - (p.x - p.reference)[lower, 1].mean()
    assert opening > 5e-3
    assert np.abs(stress[upper | lower, 1]).mean() < 0.1 * stress[ahead, 1].mean()


def test_without_load_a_crack_changes_nothing(build):
    """Nodal mass is shared between the fields of a node, none is lost."""
    solver = make_solver(cracked(build, {"from": [0.0, 11.5], "to": [12.0, 11.5]}))
    assert solver.M.sum() == pytest.approx(24.0 * 24.0, rel=1e-13)
    assert solver.M[solver.grid.size :].sum() > 0.0


def test_an_oblique_edge_crack_keeps_its_line_beyond_the_face(build):
    solver = make_solver(cracked(build, {"from": [0.0, 4.0], "to": [12.0, 16.0]}))
    x0, y0, x1, y1 = solver.cracks.segments[0]
    assert (x1, y1) == (12.0, 16.0)
    assert x0 < -2.0
    assert y0 - x0 == pytest.approx(4.0)
