"""One figure of a field: its title, labels and axes."""

from __future__ import annotations

import itertools

import pytest

from gimpmd_deploy.figures.fields import Choice, looks_of
from gimpmd_deploy.figures.picture import draw_picture
from gimpmd_deploy.figures.shown import show
from gimpmd_deploy.figures.style import pyplot
from tests.deploy.figures.three_d import make_run


def picture(run, name, time, choice=Choice()):
    particles = run.particles(time)
    (look,) = looks_of(run, [name], [time], choice, lambda _: particles)
    return draw_picture(run, show(run, time, particles, name), look)


@pytest.mark.parametrize(
    ("name", "title", "label"),
    [
        (
            "sigma_xy",
            r"$\sigma_{xy}$, $t$ = 0.8 $\tau$",
            r"$\sigma_{xy}$ ($\epsilon$/$\sigma$$^2$)",
        ),
        ("velocity_x", r"$v_{x}$, $t$ = 0.8 $\tau$", r"$v_{x}$ ($\sigma$/$\tau$)"),
        ("temperature", r"Temperature, $t$ = 0.8 $\tau$", r"temperature ($\epsilon$/$k_B$)"),
        ("level", r"Level, $t$ = 0.8 $\tau$", "level"),
    ],
)
def test_title_and_unit(block, name, title, label):
    figure = picture(block, name, 0.8)
    whole, bar = figure.axes[0], figure.axes[-1]
    assert whole.get_title(loc="left") == title
    assert label in {axes.get_xlabel() for axes in figure.axes}
    assert bar is not whole
    pyplot().close(figure)


@pytest.mark.parametrize("window", [None, ((30.0, 70.0), (20.0, 60.0))])
def test_no_text_overlaps_another(block, window):
    figure = picture(block, "velocity_y", 0.8, Choice(window=window))
    figure.canvas.draw()
    texts = [text for axes in figure.axes for text in _texts(axes)] + figure.legends
    boxes = [text.get_window_extent() for text in texts]
    for (one, first), (other, second) in itertools.combinations(zip(texts, boxes, strict=True), 2):
        assert not first.overlaps(second), (str(one), str(other))
    whole = figure.bbox
    assert all(box.x1 <= whole.x1 and box.x0 >= 0 and box.y0 >= 0 for box in boxes)
    pyplot().close(figure)


def _texts(axes):
    """All texts of axes that are drawn."""
    found = [axes.title, axes._left_title]
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        found += [label for place, label in ticks if low <= place <= high]
        found += [axis.label, axis.get_offset_text()]
    return [text for text in found if text.get_text() and text.get_visible()]


def test_a_slice_says_where(tmp_path):
    figure = picture(make_run(tmp_path), "sigma_yy", 0.0)
    assert figure.axes[0].get_title(loc="left").endswith(r"slice at $z$ = 12 $\sigma$")
    pyplot().close(figure)
