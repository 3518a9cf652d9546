"""Progress of a run as plain lines."""

import io

import msgspec
import pytest
from rich.console import Console

from gimpmd_deploy.launch.progress import Display, Pace
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.events import (
    Found,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)
from tests.cases import CASE, CONTINUUM_ONLY, changed


def pace(changes=None):
    return Pace.of(make_plan(msgspec.convert(changed(CASE, changes or {}), Case)), 1000)


def test_speed_in_steps_and_in_atom_steps():
    assert pace().speed(10, 2.0) == "200 MD steps/s, 200 k atom-steps/s"
    assert pace(CONTINUUM_ONLY).speed(10, 2.0) == "5 steps/s"
    assert pace().speed(0, 2.0) == pace().speed(1, 0.0) == ""


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (Registered("md/0"), "md/0 has joined"),
        (Progress(step=10, last_step=10, time=0.8), "step 10 of 10  t = 0.8 tau"),
        (Found(3, "a defect at [1, 2]"), "warning: a defect at [1, 2]"),
        (Waiting(("md/0", "md/1"), 12.0), "waiting for md/0, md/1 (12 s)"),
        (Lost("md/0", 7, "silent"), "md/0 lost at step 7"),
        (ServiceFailed("md/0", "no pair style", 2), "md/0 failed"),
    ],
)
def test_events_as_lines(event, words):
    text = io.StringIO()
    with Display(Console(file=text, width=100), pace()) as display:
        display.event(event)
        display.tick()
    assert words in text.getvalue()


def test_a_bar_on_a_terminal():
    text = io.StringIO()
    with Display(Console(file=text, width=100, force_terminal=True), pace()) as display:
        for step in (1, 5):
            display.event(Progress(step=step, last_step=10, time=0.08 * step))
        display.drawn = float("-inf")
        display.tick()
    assert "step 5 of 10" in text.getvalue()
