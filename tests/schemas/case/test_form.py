"""Faces by axis and side, and planes by face."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.form import Case, Planes

Make = Callable[..., Case]


def face(case: Case, axis: int, side: int) -> Face:
    (only,) = case.boundary.parts(axis, side).values()
    return only


def test_faces_by_axis_and_side(make: Make) -> None:
    case = make(boundary={name: {"ramp": i} for i, name in enumerate(("left", "right", "bottom"))})
    assert [face(case, a, s).ramp for a in (0, 1) for s in (0, 1)] == [0, 1, 2, 0]
    case = make(boundary={"back": {"ramp": 1}, "front": {"ramp": 2}})
    assert [face(case, 2, side).ramp for side in (0, 1)] == [1, 2]


def test_planes_are_infinite_where_there_is_none() -> None:
    planes = Planes(right=3.0, bottom=1.0, front=2.0)
    inf = float("inf")
    assert planes.limits(2) == ((-inf, 3.0), (1.0, inf))
    assert planes.limits(3) == ((-inf, 3.0), (1.0, inf), (-inf, 2.0))
