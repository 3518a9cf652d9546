"""Parts of faces: which positions belong to them, and how much of a box they cover."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan

Make = Callable[..., Case]
DOMAIN = ((0.0, 50.0), (0.0, 80.0))
BLOCK = (*DOMAIN, (0.0, 20.0))


def part(face: Face, axis: int = 0, domain: tuple[tuple[float, float], ...] = DOMAIN) -> FacePart:
    return FacePart(axis, 0, "boundary.left", face, domain, np.eye(3))


def test_a_position_on_the_border_of_two_parts_belongs_to_the_upper_one() -> None:
    lower, upper = part(Face(extent=((0, 40),))), part(Face(extent=((40, 80),)))
    x = np.array([[3.0, 0.0], [3.0, 39.9], [3.0, 40.0], [3.0, 80.0], [3.0, 81.0], [3.0, -1.0]])
    assert lower.covers(x).tolist() == [True, True, False, False, False, True]
    assert upper.covers(x).tolist() == [False, False, True, True, True, False]


def test_a_face_with_one_condition_has_no_limits() -> None:
    assert part(Face()).region is None
    assert part(Face()).covers(np.array([[9.0, -5.0]])).all()


def test_extents_follow_the_other_axes_in_three_dimensions() -> None:
    bottom = part(Face(extent=((10, 50), (0, 5))), axis=1, domain=BLOCK)
    assert bottom.region == ((10, math.inf), (-math.inf, math.inf), (-math.inf, 5))


def test_overlap_with_a_box_is_a_length_or_an_area() -> None:
    left = part(Face(extent=((20, 60),)))
    assert left.overlap(((0, 30), (50, 80))) == pytest.approx(10.0)
    assert left.overlap(((0, 30), (65, 80))) == 0.0
    bottom = part(Face(extent=((10, 50), (0, 5))), axis=1, domain=BLOCK)
    assert bottom.overlap(((0, 20), (0, 10), (0, 20))) == pytest.approx(50.0)


def test_symmetry_prescribes_the_normal_component() -> None:
    assert part(Face(condition="symmetry"), axis=1).components == (None, 0.0)


def test_faces_without_a_condition_are_no_parts(make: Make) -> None:
    pull = {"condition": "velocity", "value": [1, None]}
    left = [pull | {"extent": [[0, 30]]}, {"extent": [[30, 40]]}, pull | {"extent": [[50, 80]]}]
    plan = make_plan(make(only="continuum", boundary={"left": left}))
    assert [found.key for found in plan.face_parts()] == ["boundary.left[0]", "boundary.left[2]"]


def test_a_part_holds_the_positions_on_its_face() -> None:
    lower = part(Face(condition="symmetry", extent=((0.0, 40.0),)))
    x = np.array([[0.0, 10.0], [1e-7, 10.0], [1.0, 10.0], [0.0, 60.0]])
    assert lower.holds(x, 1e-6).tolist() == [True, True, False, False]
