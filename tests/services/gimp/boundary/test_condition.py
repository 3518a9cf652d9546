"""What all conditions share: order of the hooks, and use by several solvers."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_gimp.boundary.elastic_foundation import ElasticFoundation
from gimpmd_gimp.boundary.prescribed_displacement import PrescribedDisplacement
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver


def body(*conditions: Condition, cells: int = 8, **method: Any) -> Solver:
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (cells, 6), (False, True)))
    law = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
    return Solver(mesh, fill(mesh, 2, 1.0), law, Method(**method), 0.2, conditions=conditions)


class Recorder(Condition):
    """Notes the hooks that a step calls."""

    reimposed: ClassVar[bool] = True

    def __init__(self, calls: list[str]) -> None:
        self._calls = calls

    def add_impulse(self, kick: Kick, level: int) -> None:
        self._calls.append("add_impulse")

    def constrain_change(self, kick: Kick) -> None:
        self._calls.append("constrain_change")

    def constrain_motion(self) -> None:
        self._calls.append("constrain_motion")

    def end_kick(self) -> None:
        self._calls.append("end_kick")

    def constrain_velocity(self, V: np.ndarray, coarsest: int, share: float) -> None:
        self._calls.append("constrain_velocity")


IMPOSED = ["constrain_change"]
KNOWN = ["constrain_velocity"]


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ({"integrator": "musl"}, ["add_impulse", *IMPOSED, "end_kick", *KNOWN]),
        (
            {"integrator": "usl"},
            [*KNOWN, "add_impulse", *IMPOSED, "constrain_motion", "end_kick"],
        ),
        (
            {"integrator": "usavg"},
            [*KNOWN, "add_impulse", *IMPOSED, "constrain_motion", "end_kick", *KNOWN],
        ),
        (
            {"integrator": "musl", "configuration": "reference", "dispersion": correction(0.25)},
            ["add_impulse", *IMPOSED, *IMPOSED, "end_kick", *KNOWN, *KNOWN],
        ),
    ],
    ids=["musl", "usl", "usavg", "dispersion"],
)
def test_hooks_act_in_the_order_of_the_protocol(method, expected) -> None:
    calls: list[str] = []
    solver = body(Recorder(calls), **method)
    calls.clear()
    solver.step()
    assert calls == expected


def test_one_condition_serves_several_solvers() -> None:
    """Solvers of different bodies work with copies of the same conditions."""
    conditions = [
        Traction(0, 1, (1e-3, 2e-3), lambda time: time),
        BodyForce(lambda X, time: 1e-3 * X),
        ElasticFoundation(0, 1, 0.1),
        Absorbing(0, 1),
        PrescribedVelocity(0, 0, 0, lambda time: 1e-3 * time),
        PrescribedDisplacement(0, 0, 1, lambda time: 1e-3 * time**2),
    ]
    lone = body(*conditions)
    small, large = (body(*conditions, cells=cells) for cells in (8, 12))
    for solver in (lone, small, large):
        for _ in range(10):
            solver.step()
    for name in ("x", "v", "F"):
        np.testing.assert_array_equal(getattr(lone.points, name), getattr(small.points, name))
    assert np.abs(lone.points.v).max() > 0.0


@pytest.mark.parametrize("condition", [Absorbing(0, 0), Traction(0, 0, (1.0, 0.0), lambda _: 1.0)])
def test_conditions_that_need_sums_of_their_own_cannot_come_later(condition) -> None:
    with pytest.raises(ValueError, match="from the start"):
        body().add_condition(condition)
