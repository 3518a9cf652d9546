"""Conditions on the rim: which faces, their ramp and their force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gimpmd_md.loads import RimFace
from gimpmd_md.loads import rim_faces as faces_of_plan
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.units import UNITS

Make = Callable[..., Case]
TOP = {"condition": "traction", "value": [None, 0.2], "ramp": 1.0}


def rim_faces(case: Case, conditions: tuple[str, ...]) -> list[RimFace]:
    return faces_of_plan(make_plan(case), conditions)


def test_only_faces_on_the_rim_of_the_domain_count(make: Make) -> None:
    loads = {"top": TOP, "bottom": TOP, "left": {"condition": "symmetry"}}
    inside = make(boundary=loads)
    assert rim_faces(inside, ("traction", "symmetry")) == []
    above = make(boundary=loads, md__region=[[13, 39], [26, 52]])
    assert [face.name for face in rim_faces(above, ("traction",))] == ["top"]
    alone = make(boundary=loads, only="md")
    assert [face.name for face in rim_faces(alone, ("traction",))] == ["bottom", "top"]
    assert [face.name for face in rim_faces(alone, ("symmetry",))] == ["left"]


def test_regions_share_a_face_by_their_lengths(make: Make) -> None:
    """Of three regions two end on the top of the domain."""
    boxes = [[[0, 13], [40, 52]], [[39, 45], [30, 52]], [[13, 30], [6, 12]]]
    case = make(boundary={"top": TOP, "left": TOP}, md__region=None, md__regions=boxes)
    left, top = rim_faces(case, ("traction",))
    assert (left.name, left.size) == ("left", 12.0)
    assert (top.name, top.size) == ("top", 19.0)


@pytest.mark.parametrize(("start", "end"), [(0.0, 0.4), (0.8, 1.3), (2.0, 2.1)])
def test_mean_of_the_ramp_makes_displacements_exact(make: Make, start: float, end: float) -> None:
    (face,) = rim_faces(make(boundary={"top": TOP}, only="md"), ("traction",))
    times = np.linspace(start, end, 100001)
    factors = np.minimum(times, 1.0)
    mean = np.sum(0.5 * (factors[1:] + factors[:-1])) / 100000
    assert face.mean_factor(start, end) == pytest.approx(mean, rel=1e-8)


def test_force_is_traction_times_length_in_the_style_s_units(make: Make) -> None:
    (face,) = rim_faces(make(boundary={"top": TOP}, only="md"), ("traction",))
    assert face.force("lj").tolist() == pytest.approx([0.0, 0.2 * 52.0])
    assert face.force("metal")[1] == pytest.approx(0.2 * 52.0 / UNITS["metal"].nktv2p)


def test_symmetry_holds_the_normal_component(make: Make) -> None:
    sides = {"left": {"condition": "symmetry"}, "top": {"condition": "symmetry"}}
    left, top = rim_faces(make(boundary=sides, only="md"), ("symmetry",))
    assert left.velocity(2) == (0.0, None)
    assert top.velocity(2) == (None, 0.0)
    assert top.velocity(3) == (None, 0.0, None)


def test_layer_is_within_a_depth_of_the_outermost_atoms_of_all_ranks() -> None:
    x = np.array([[0.0, 0.0], [1.0, 5.0], [2.0, 9.5]])
    low, high = np.array([-1.0, 0.0]), np.array([2.0, 10.0])
    top, left = RimFace(1, 1, Face(), 1.0), RimFace(0, 0, Face(), 1.0)
    assert top.layer(low, high, x, 1.0).tolist() == [False, False, True]
    assert left.layer(low, high, x, 1.5).tolist() == [True, False, False]
