"""Nested levels: what belongs to the composite basis, and what the other nodes stand for."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_schemas.case.checks.levels import MARGIN


def nested(dim: int, periodic: bool = False) -> Hierarchy:
    """Three levels, boxes in the middle; level 1 reaches the domain's lower face along x."""
    return Hierarchy(
        low=(-1.0, 2.0, 0.5)[:dim],
        cell=1.0,
        cells=(32,) * dim,
        periodic=(periodic,) * dim,
        finer=(
            (((0, 44), *[(16, 48)] * (dim - 1)),),
            (((20, 60), *[(50, 78)] * (dim - 1)),),
        ),
    )


def lattice(h: Hierarchy, level: int, box) -> np.ndarray:
    axes = [np.arange(low - 2, high + 3) for low, high in box]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, h.dim)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_parents_reproduce_linear_fields_and_sum_to_one(dim, level):
    h = nested(dim)
    coords = lattice(h, level, h.boxes(level)[0])
    covered = (
        h.inside(level + 1, 2 * coords, shrink=8) if level < h.top else np.zeros(len(coords), bool)
    )
    coords = coords[~covered]
    row, levels, nodes, weight = h.parents(np.full(len(coords), level), coords)
    assert np.bincount(row, weight) == pytest.approx(np.ones(len(coords)), abs=1e-15)
    for value in np.unique(levels):
        assert h.is_basis(int(value), nodes[levels == value]).all()
    x = h.position(np.full(len(coords), level), coords)
    for axis in range(dim):
        taken = np.bincount(row, weight * h.position(levels, nodes)[:, axis])
        assert taken == pytest.approx(x[:, axis], abs=1e-12)


def test_no_nodes_have_no_parents():
    """As on a rank that owns all nodes which it needs."""
    row, levels, nodes, weight = nested(2).parents(np.zeros(0, int), np.zeros((0, 2), int))
    assert (row.size, levels.size, nodes.shape, weight.size) == (0, 0, (0, 2), 0)


def test_a_hanging_node_is_the_mean_of_its_coarser_neighbours():
    h = nested(2)
    row, levels, nodes, weight = h.parents(np.array([1]), np.array([[44, 21]]))
    assert row.tolist() == [0, 0]
    assert levels.tolist() == [0, 0]
    assert sorted(nodes.tolist()) == [[22, 10], [22, 11]]
    assert weight.tolist() == [0.5, 0.5]


def test_a_coarse_node_under_a_finer_level_is_the_finer_node():
    h = nested(2)
    _, levels, nodes, weight = h.parents(np.array([0]), np.array([[21, 20]]))
    assert (levels.tolist(), nodes.tolist(), weight.tolist()) == ([1], [[42, 40]], [1.0])


def test_a_level_has_no_rim_on_the_face_of_the_domain():
    h = nested(2)
    on_face = np.array([[0, 30], [-2, 30]])
    assert h.is_basis(1, on_face).all()
    assert not h.is_basis(1, np.array([[44, 30]])).any()


def test_across_periodic_faces_images_are_taken_back():
    h = Hierarchy((0.0,), 1.0, (32,), (True,), ((((40, 52),),),))
    _, levels, nodes, _ = h.parents(np.array([0, 0]), np.array([[-1], [33]]))
    assert levels.tolist() == [0, 0]
    assert nodes.tolist() == [[31], [1]]


def test_distance_is_negative_inside_and_open_on_faces():
    h = nested(2)
    x = np.array([[-1.0, 18.0], [20.0, 18.0], [23.0, 18.0], [0.0, 9.0]])
    # level 1 spans x from -1 (the face) to 21 and y from 10 to 26
    assert h.distance(1, x) == pytest.approx([-8.0, -1.0, 2.0, 1.0])


NEAR = 2 * MARGIN  # the margin in cells of the finer level
MIDDLE = (40, 60)


def plane(*finer, periodic=False) -> Hierarchy:
    """Boxes of levels 1, 2, ... in a plane of 64 x 64 coarsest cells; along y it may repeat."""
    return Hierarchy((0.0, 0.0), 1.0, (64, 64), (False, periodic), finer)


@pytest.mark.parametrize(
    "box",
    [
        ((NEAR, 128 - NEAR), MIDDLE),
        (MIDDLE, (NEAR, 128 - NEAR)),
        ((0, 60), (40, 128)),  # on faces of the domain
    ],
)
def test_a_box_that_keeps_the_margin(box):
    assert plane((box,)).boxes(1) == (box,)


@pytest.mark.parametrize(
    "box",
    [
        ((NEAR - 2, 60), MIDDLE),
        ((40, 128 - NEAR + 2), MIDDLE),
        (MIDDLE, (NEAR - 2, 60)),
        (MIDDLE, (40, 130)),  # beyond the domain
    ],
)
def test_a_box_close_to_the_rim_is_refused(box):
    with pytest.raises(ValueError, match="of level 1 does not lie inside a box of level 0 with"):
        plane((box,))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("pair", [(41, 60), (40, 61)])
def test_a_box_between_coarser_node_lines_is_refused(axis, pair):
    box = [MIDDLE, MIDDLE]
    box[axis] = pair
    with pytest.raises(ValueError, match="of level 1 ends between node lines of level 0"):
        plane((tuple(box),))


def test_a_finer_level_keeps_the_margin_in_one_box_of_the_coarser():
    coarse = ((32, 80), (32, 80))  # 64 to 160 on the lattice of level 2
    near = (64 + NEAR, 160 - NEAR)
    assert plane((coarse,), ((near, near),)).top == 2
    with pytest.raises(ValueError, match="of level 2 does not lie inside a box of level 1"):
        plane((coarse,), ((near, (near[0], near[1] + 2)),))
    with pytest.raises(ValueError, match="of level 2 does not lie inside a box of level 1"):
        plane((coarse,), (((0, near[1]), near),))  # on the face of the domain, where level 1 is not
    apart = (((0, 40), MIDDLE), ((40 + NEAR, 90), MIDDLE))
    with pytest.raises(ValueError, match="of level 2 does not lie inside a box of level 1"):
        plane(apart, (((60, 120), (98, 102)),))


def test_a_box_spans_a_periodic_axis_or_keeps_the_margin():
    assert plane(((MIDDLE, (0, 128)),), periodic=True).top == 1
    assert plane(((MIDDLE, (NEAR, 128 - NEAR)),), periodic=True).top == 1
    with pytest.raises(ValueError, match="does not lie inside"):
        plane(((MIDDLE, (0, 60)),), periodic=True)


@pytest.mark.parametrize("axis", [0, 1])
def test_boxes_of_one_level_keep_the_margin(axis):
    def pair(gap):
        a, b = [(20, 40), MIDDLE], [(40 + gap, 90), MIDDLE]
        return tuple(tuple(box if axis == 0 else box[::-1]) for box in (a, b))

    assert len(plane(pair(NEAR)).boxes(1)) == 2
    for gap in (NEAR - 2, -10):
        with pytest.raises(ValueError, match="of level 1 overlap or come closer than"):
            plane(pair(gap))
