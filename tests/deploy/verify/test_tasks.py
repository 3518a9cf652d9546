"""Which strips a verification runs."""

from __future__ import annotations

import numpy as np

from gimpmd_deploy.verify.tasks import plan_tasks
from tests.deploy.verify.crystal import HEXAGONAL, IN_SPACE, ground


def test_all_strips_of_a_plan() -> None:
    cut = ground(HEXAGONAL)
    quick = plan_tasks(cut, (8.0, 20.0), quick=True)
    assert len(quick) == 2 * 2 * 3
    assert {task.only for task in quick} == {None, "continuum"}
    assert quick[0].wave.wavelength == 20.0
    whole = plan_tasks(cut, (8.0, 20.0), quick=False)
    assert len(whole) == 3 * 2 * 4
    assert len({task.name for task in whole}) == len(whole)
    assert {task.wave.wavelength for task in whole if task.wave.degrees} == {8.0}


def test_strips_in_space() -> None:
    """No oblique waves where the material may not be isotropic, and no strips of atoms only."""
    stiffness = np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]).tolist()
    cubic = {"from": "stiffness", "density": 1.0, "stiffness": stiffness}
    cut = ground((1.3, 1.3, 1.3), **IN_SPACE | {"continuum.material": cubic})
    tasks = plan_tasks(cut, (8.0,), quick=False)
    assert {task.wave.degrees for task in tasks} == {0.0}
    assert {task.only for task in tasks} == {None, "continuum"}
    assert len(tasks) == 2 * 3
