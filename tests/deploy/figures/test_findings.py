"""Marks of findings in figures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gimpmd_deploy.figures.findings import mark_places, mark_times
from gimpmd_deploy.figures.style import pyplot
from gimpmd_deploy.results.findings import RunFinding


def finding(time: float, kind: Any, place: tuple[float, ...] | None) -> RunFinding:
    return RunFinding(
        step=1,
        time=time,
        side="md",
        kind=kind,
        value=2.0,
        limit=1.0,
        place=place,
        message="",
    )


RUN = SimpleNamespace(
    findings=(
        finding(1.0, "broken bond", (3.0, 4.0)),
        finding(1.0, "mass", None),
        finding(2.0, "strain", (5.0, 6.0, 7.0)),
    )
)


@pytest.fixture
def axes():
    figure, axes = pyplot().subplots()
    yield axes
    pyplot().close(figure)


def crosses(axes: Any) -> list[tuple[float, float]]:
    return [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines]


@pytest.mark.parametrize(
    ("time", "places", "kinds"),
    [
        (0.5, [], ""),
        (1.0, [(3.0, 4.0)], "broken bond, mass"),
        (9.0, [(3.0, 4.0), (5.0, 6.0)], "broken bond, mass, strain"),
    ],
)
def test_a_picture_shows_the_findings_until_its_time(axes, time, places, kinds) -> None:
    mark_places(axes, RUN, time)
    assert crosses(axes) == places
    texts = [text.get_text() for text in axes.texts]
    assert texts == ([f"not reliable: {kinds} (see gimpmd report)"] if kinds else [])


def test_a_line_at_each_time_of_findings(axes) -> None:
    mark_times(axes, RUN)
    assert [line.get_xdata()[0] for line in axes.lines] == [1.0, 2.0]
    assert [text.get_text() for text in axes.texts] == ["broken bond, mass", "strain"]


def test_a_sound_run_has_no_marks(axes) -> None:
    mark_places(axes, SimpleNamespace(findings=()), 1.0)
    mark_times(axes, SimpleNamespace(findings=()))
    assert not axes.lines
    assert not axes.texts
