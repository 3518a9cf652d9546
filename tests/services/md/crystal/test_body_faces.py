"""Planes that end at faces of the body."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.crystal.body_faces import Face, depth_of_layers, even, moment
from gimpmd_md.crystal.plane_pairs import Planes
from gimpmd_md.crystal.recognise import Crystal

ROW = 0.5 * 3.0**0.5
HEXAGONAL = Crystal(
    np.array([[1.0, 0.0], [0.5, ROW]]), np.array([0.25, 0.5 * ROW]), np.zeros((1, 2)), np.array([1])
)
SQUARE = Crystal(np.eye(2), np.array([0.5, 0.5]), np.zeros((1, 2)), np.array([1]))
LEFT, RIGHT, BOTTOM = Face(0, 0, 0.0), Face(0, 1, 12.0), Face(1, 0, 0.0)


def at(second: float, clear: float = 0.5) -> Planes:
    return Planes(0.0, second, clear)


def test_a_face_half_a_layer_beyond_the_atoms() -> None:
    assert depth_of_layers(HEXAGONAL, LEFT) == pytest.approx(0.5)
    assert depth_of_layers(HEXAGONAL, RIGHT) == pytest.approx(0.5)
    assert depth_of_layers(HEXAGONAL, Face(0, 0, 0.1)) == pytest.approx(0.3)
    assert depth_of_layers(HEXAGONAL, Face(0, 1, 12.1)) == pytest.approx(0.7)


def test_moments_alternate_from_layer_to_layer() -> None:
    """The last row ends a quarter of a spacing nearer to the face, or farther, than on average."""
    size = 0.125 * ROW
    for row in (5, 6):
        sign = -1.0 if row % 2 else 1.0  # rows of odd number reach the face
        for face in (LEFT, RIGHT):
            reach = sign if face is LEFT else -sign
            assert moment(HEXAGONAL, 1, 1, row * ROW, face) == pytest.approx(reach * size)
        # the row inside a lower plane is the next one
        assert moment(HEXAGONAL, 1, 0, row * ROW, LEFT) == pytest.approx(-sign * size)
        assert moment(HEXAGONAL, 0, 1, row * 0.5, BOTTOM) == pytest.approx(-sign * size)


def test_layers_that_all_end_alike_have_no_moment() -> None:
    assert moment(SQUARE, 1, 1, 5.0, LEFT) == pytest.approx(0.0)


def test_even_numbers_of_layers_are_chosen() -> None:
    low = 1, 0, [at(-4 * ROW)]
    high = 1, 1, [at(5 * ROW, 0.5), at(6 * ROW, 0.4), at(8 * ROW, 0.3)]
    assert even(HEXAGONAL, [low, high], [LEFT]) == [at(-4 * ROW), at(6 * ROW, 0.4)]
    assert even(HEXAGONAL, [low, high], []) == [at(-4 * ROW), at(5 * ROW, 0.5)]
    assert even(SQUARE, [low, (1, 1, [at(5.0)])], [LEFT]) is not None
    assert even(HEXAGONAL, [low, (1, 1, [at(5 * ROW)])], [LEFT]) is None


def test_in_a_corner_both_outermost_layers_reach_their_faces() -> None:
    for column, row, good in ((5, 7, True), (6, 8, True), (5, 8, False), (6, 7, False)):
        options = [(0, 1, [at(0.5 * column)]), (1, 1, [at(row * ROW)])]
        assert (even(HEXAGONAL, options, [LEFT, BOTTOM]) is not None) == good


def test_a_row_of_options_keeps_its_order() -> None:
    options = [(axis, side, [at(1.0), at(2.0)]) for axis in range(3) for side in range(2)]
    chosen = even(SQUARE, options, [])
    assert chosen is not None
    np.testing.assert_array_equal([p.second for p in chosen], 1.0)
