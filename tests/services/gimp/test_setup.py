"""From a plan to a solver: conditions of the faces, method, cracks."""

from __future__ import annotations

from typing import get_args

import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.elastic_foundation import ElasticFoundation
from gimpmd_gimp.boundary.prescribed_displacement import PrescribedDisplacement
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.setup import make_conditions, make_solver, thread_count
from gimpmd_schemas.case.conditions import ConditionName
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.registry import collect

FREE = {"box": [[0.0, 32.0], [0.0, 8.0]], "periodic": [False, False]}
MATERIAL = {"from": "moduli", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0}


def test_loads_come_before_prescribed_values(build) -> None:
    """Faces count from left to top; their order stays within loads and within prescribed values."""
    case = build(
        domain=FREE,
        boundary={
            "left": {"condition": "displacement", "value": [0.1, 0.0], "ramp": 1.0},
            "right": {"condition": "traction", "value": [1e-3, 0.0]},
            "bottom": {"condition": "symmetry"},
            "top": {"condition": "foundation", "stiffness": 0.1},
        },
        continuum={
            "material": MATERIAL,
            "xpic": {"every": 0},
            "body_force": {"acceleration": [0.0, -1e-3]},
        },
    )
    assert [type(one) for one in make_conditions(make_plan(case))] == [
        *(Traction, ElasticFoundation, BodyForce),
        *(PrescribedDisplacement, PrescribedDisplacement, PrescribedVelocity),
    ]


def test_components_left_free_have_no_condition(build) -> None:
    face = {"condition": "velocity", "value": [None, 1e-3]}
    (condition,) = make_conditions(make_plan(build(domain=FREE, boundary={"left": face})))
    assert isinstance(condition, PrescribedVelocity)
    assert condition.velocity(0, 5.0) == 1e-3


def test_every_condition_of_the_case_form_is_known() -> None:
    """And the case form knows every condition that a module makes."""
    made = set(collect("gimpmd_gimp.boundary", "FACE_CONDITIONS"))
    assert made | {"free"} == set(get_args(ConditionName))


def test_a_free_face_has_no_condition(build) -> None:
    assert make_conditions(make_plan(build(domain=FREE))) == []


def test_a_foundation_of_a_case_holds_the_body(build) -> None:
    """Its stiffness is in pressure units per length; in lj units no factor applies."""
    case = build(
        domain=FREE,
        boundary={
            "left": {"condition": "foundation", "stiffness": 0.1},
            "right": {"condition": "absorbing"},
        },
        initial={"velocities": [{"velocity": [-1e-3, 0.0]}]},
    )
    solver = make_solver(make_plan(case))
    foundation, absorbing = solver.conditions
    assert isinstance(foundation, ElasticFoundation)
    assert isinstance(absorbing, Absorbing)
    for _ in range(20):
        solver.step()
    assert foundation.energy() > 0.0


@pytest.mark.parametrize(("threads", "ranks", "expected"), [(3, 1, 3), (1, 4, 1)])
def test_thread_count(threads, ranks, expected) -> None:
    assert thread_count(threads, ranks) == expected
    assert thread_count("auto", 10_000) == 1
