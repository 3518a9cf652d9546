"""Points that split and merge: what becomes of their history variables."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import J2Plasticity
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

LAW = J2Plasticity(1.0, 1.0 / 3.0, 1.0 / 3.0, 1.0, 0.1, 2)
FINER = ((((10, 28), (10, 28)),),)


def field(points: MaterialPoints) -> np.ndarray:
    """A linear function of the reference position."""
    return np.asarray(1.0 + points.reference @ [0.1, 0.2])


def test_history_of_parts_is_that_of_the_whole_and_of_a_whole_the_mean() -> None:
    """A body that moves across a finer level without strain.

    A merged point has the mean of a linear field at the mean of the positions, exactly.
    """
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (20, 20), (True, True), FINER))
    points = fill(mesh, 2, LAW.density, history_size(LAW))
    points.v[:] = 0.25, 0.1
    points.history[:, -1] = field(points)
    before, total = set(points.id.tolist()), float(points.volume @ points.history[:, -1])
    solver = Solver(mesh, points, LAW, Method("musl", xpic_every=0), 0.2)
    for _ in range(60):
        solver.step()
    p = solver.points
    np.testing.assert_allclose(p.volume @ p.history[:, -1], total, rtol=1e-13)
    assert not p.history[:, :-1].any()
    off = np.abs(p.history[:, -1] - field(p))
    merged = (p.level == 0) & ~np.isin(p.id, list(before))
    assert merged.sum() > 20
    assert off[merged].max() < 1e-12
    split = off > 1e-12
    assert split.sum() > 20
    assert (p.level[split] == 1).all()
    # a part lies an eighth of a coarser cell away from its whole along both axes
    assert (np.minimum(np.abs(off[split] - 0.0125), np.abs(off[split] - 0.0375)) < 1e-12).all()
