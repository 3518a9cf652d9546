"""Which points and nodes take part in the steps of finer levels."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid import subcycling
from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.points.groups import MovedFrom, OfLevel, Summed
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.physics.gimp.bodies import body

BOXES = {
    "1-D": ((48,), ((((24, 72),),), (((72, 120),),))),
    "2-D": ((24, 24), ((((16, 32), (16, 32)),),)),
    "2-D, three levels": ((32, 24), ((((12, 52), (8, 40)),), (((48, 80), (32, 64)),))),
}


def solver_of(name: str) -> Solver:
    """A body whose points stand a little beside their places of rest."""
    cells, finer = BOXES[name]

    def drifted(p) -> None:
        p.x += 0.2 * np.random.default_rng(0).uniform(-1.0, 1.0, p.x.shape)

    free = (False,) * len(cells)
    return body(cells, Method("musl", xpic_every=0), 0.4, drifted, periodic=free, finer=finer)


def touched(solver: Solver) -> np.ndarray:
    """Which nodes each point touches, dense, hanging nodes replaced by their parents."""
    s, (n, d) = solver.body.stencils, solver.points.x.shape
    found = np.zeros((n, solver.mesh.size), dtype=np.bool_)
    weight = np.stack([s.w[:, 0], 1.0 - s.w.sum(axis=1), s.w[:, 1]], axis=1)  # (n, 3, d)
    for place in np.ndindex((3,) * d):
        heavy = (weight[:, place, np.arange(d)] > 0.0).all(axis=1)
        node = s.base + s.strides[s.block] @ np.array(place)
        found[np.flatnonzero(heavy), node[heavy]] = True
    c = solver.mesh.constraints
    for row, node in enumerate(c.node):
        points = found[:, node].copy()
        found[:, node] = False
        for parent in c.parent[c.start[row] : c.start[row + 1]]:
            found[:, parent] |= points
    return found


@pytest.mark.parametrize("top", [0, 1, 3])
def test_steps_of_every_level_add_up_to_the_coarsest(top) -> None:
    clock = Clock(0.125, top, "usl")
    spans = np.zeros(top + 1)
    for step in range(2**top):
        first = subcycling.coarsest(step, top)
        assert first == min(level for level in range(top + 1) if step % 2 ** (top - level) == 0)
        for level in range(first, top + 1):
            spans[level] += clock.dt_of(level)
    np.testing.assert_array_equal(spans, clock.dt_of(0))
    assert subcycling.coarsest(2**top, top) == 0


@pytest.mark.parametrize("name", BOXES)
def test_points_that_move_in_a_sub_step_read_complete_sums(name) -> None:
    """Every node that they touch is solved, and gets the parts of all points that touch it."""
    solver = solver_of(name)
    found = touched(solver)
    for level in range(1, solver.top + 1):
        active = solver.nodes.active[level]
        moved, summed = (solver.body.mask(group(level)) for group in (MovedFrom, Summed))
        assert solver.body.mask(OfLevel(level)).sum() < moved.sum() < summed.sum()
        read = np.flatnonzero(found[moved].any(axis=0))
        assert np.isin(read, active.solved).all()
        assert not found[~summed][:, active.solved].any()
        # sums go to nodes that have been cleared
        written = np.flatnonzero(found[summed].any(axis=0))
        assert np.isin(written, active.cleared).all()
        assert summed.sum() < len(summed)
        assert active.solved.size < solver.nodes.active[0].solved.size


@pytest.mark.parametrize("name", BOXES)
def test_points_outside_feel_no_kick_of_the_finer_level(name) -> None:
    """Nodes that points of the level touch are only touched by points that move in its steps."""
    solver = solver_of(name)
    found = touched(solver)
    for level in range(1, solver.top + 1):
        own = solver.points.level >= level
        kicked = found[own].any(axis=0)
        moved = solver.body.mask(MovedFrom(level))
        assert not found[~moved][:, kicked].any()


def test_distances_in_cells_of_the_coarser_level() -> None:
    h = Hierarchy((0.0,), 2.0, (40,), (False,), ((((40, 60),),),))  # level 1 from 40 to 60
    x = np.array([[32.9], [33.1], [40.0], [66.9], [67.1]])
    level = np.array([0, 0, 1, 0, 0], dtype=np.int32)
    assert subcycling.rate_of(level, x, h).tolist() == [0, 1, 1, 1, 0]
    # a corrected kick goes further: four cells and the cell of the point
    x = np.array([[29.9], [30.1], [69.9], [70.1]])
    level = np.zeros(4, dtype=np.int32)
    assert subcycling.rate_of(level, x, h).tolist() == [0, 0, 0, 0]
    assert subcycling.rate_of(level, x, h, corrected=True).tolist() == [0, 1, 1, 0]
    # four cells and 1.75 of those of the point
    x = np.array([[28.4], [28.6], [71.4], [71.6]])
    assert subcycling.finest_summed(level, x, h).tolist() == [0, 1, 1, 0]
