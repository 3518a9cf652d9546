"""Which strips a verification runs."""

from __future__ import annotations

from gimpmd_deploy.verify.tasks import plan_tasks
from tests.deploy.verify.crystal import HEXAGONAL, ground


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
