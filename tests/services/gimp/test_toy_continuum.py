"""The toy continuum under ``ContinuumSide``: the force scheme needs nothing of GIMP."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.coupling.test_force import case_of, push
from tests.services.gimp.toy_continuum import ToyContinuum


@pytest.fixture(params=[Gimp, ToyContinuum])
def side(request, tmp_path) -> ContinuumSide:
    (tmp_path / "fields").mkdir()
    plan = make_plan(case_of(0))
    made = ContinuumSide(plan, request.param(plan, None, tmp_path))
    yield made
    made.close()


def ramped(side: ContinuumSide, steps: int) -> list[np.ndarray]:
    """Forces along x that grow over the first half of the steps."""
    force = np.zeros((side.needs.size, 2))
    force[:, 0] = -3.0
    return [min(2.0 * step / steps, 1.0) * force for step in range(steps + 1)]


def test_energy_is_the_work_of_the_atoms(side) -> None:
    first, *_, last = push(side, ramped(side, 40))
    gained = last.kinetic + last.potential - first.kinetic - first.potential
    assert last.interface_work > 0.0
    assert gained == pytest.approx(last.interface_work, rel=1e-2)


def test_a_wave_from_the_atoms_moves_the_toy_as_it_moves_gimp(tmp_path) -> None:
    """The mean velocity of the pushed nodes is the same but for the different shape functions."""
    (tmp_path / "fields").mkdir()
    plan, found = make_plan(case_of(0)), []
    for code in (Gimp, ToyContinuum):
        side = ContinuumSide(plan, code(plan, None, tmp_path))
        push(side, ramped(side, 120))
        found.append(side.zone_fields()["velocity"][:, 0].mean())
        side.close()
    gimp, toy = found
    assert toy == pytest.approx(gimp, rel=0.05)


def test_velocity_schemes_refuse_a_code_without_material_points(build, tmp_path) -> None:
    case = build(
        domain={"box": [[0.0, 40.0], [0.0, 40.0]]},
        md={"region": [[0.0, 24.0], [8.0, 32.0]], "input": "none.in"},
        time={"end": 1.0, "md_timestep": 0.1, "md_steps": 1},
        only=None,
    )
    continuum = msgspec.structs.replace(case.continuum, backend="toy")
    plan = make_plan(msgspec.structs.replace(case, continuum=continuum))
    with pytest.raises(BackendError, match=r"backend = 'toy' has none; set coupling.scheme: force"):
        ContinuumSide(plan, ToyContinuum(plan, None, tmp_path))
