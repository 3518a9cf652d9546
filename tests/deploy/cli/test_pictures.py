"""Options of commands that draw fields."""

import pytest

from gimpmd_deploy.cli.pictures import choice_of, times_near
from gimpmd_deploy.figures.fields import Choice
from gimpmd_schemas.errors import InputError


def test_choices():
    assert choice_of(None, None, ["speed", "level"]) == Choice()
    chosen = choice_of((-1.0, 2.0), (0.0, 5.0, 1.0, 2.0), ["speed"])
    assert chosen == Choice((-1.0, 2.0), ((0.0, 5.0), (1.0, 2.0)))


@pytest.mark.parametrize(
    ("limits", "window", "names", "message"),
    [
        ((2.0, 1.0), None, ["speed"], r"--limits = \(2.0, 1.0\): are not in order"),
        ((1.0, 2.0), None, ["speed", "level"], "choose one of speed, level"),
        (None, (0.0, 5.0, 2.0, 2.0), ["speed"], "--window .* has no area"),
    ],
)
def test_bad_choices(limits, window, names, message):
    with pytest.raises(InputError, match=message):
        choice_of(limits, window, names)


def test_times(block):
    assert times_near(block, [0.8, 0.41, 0.8]) == pytest.approx([0.4, 0.8])
    with pytest.raises(InputError, match=r"--time = 0.6(.|\n)*at t = 0, 0.4, 0.8"):
        times_near(block, [0.4, 0.6])
