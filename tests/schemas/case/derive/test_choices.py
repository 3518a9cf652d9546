"""What auto means for the continuum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.derive import choices
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.form import Case

Make = Callable[..., Case]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ("reference", "lumped", "musl", 0)),
        ({"continuum__configuration": "current"}, ("current", "lumped", "musl", 20)),
        ({"coupling__scheme": "paper"}, ("current", "lumped", "musl", 20)),
        ({"only": "continuum"}, ("current", "lumped", "usavg", 20)),
        ({"coupling__scheme": "force"}, ("reference", "corrected", "musl", 0)),
        (
            {"coupling__scheme": "force", "continuum__dispersion": "lumped"},
            ("reference", "lumped", "musl", 0),
        ),
        (
            {"coupling__scheme": "force", "only": "continuum"},
            ("current", "lumped", "usavg", 20),
        ),
        (
            {"only": "continuum", "continuum__configuration": "reference"},
            ("reference", "lumped", "usavg", 0),
        ),
        (
            {
                "only": "continuum",
                "continuum__configuration": "reference",
                "continuum__dispersion": "corrected",
            },
            ("reference", "corrected", "musl", 0),
        ),
        (
            {"continuum__configuration": "current", "continuum__xpic__every": 3},
            ("current", "lumped", "musl", 3),
        ),
    ],
)
def test_automatic_schemes_of_the_continuum(
    make: Make, changes: dict[str, Any], expected: tuple[str, str, str, int]
) -> None:
    case = make(**changes)
    chosen = (
        choices.configuration(case),
        choices.dispersion(case),
        choices.integrator(case),
        choices.xpic_every(case),
    )
    assert chosen == expected


def test_filter_rate_is_half_the_wave_speed_over_the_cell(make: Make) -> None:
    assert choices.filter_rate(make()) == pytest.approx(0.5 * wave_speed(make(), "P") / 4.0)
    assert choices.filter_rate(make(coupling__filter_rate=0.25)) == 0.25
    assert choices.filter_rate(make(coupling__scheme="paper")) == 0.0


def test_an_absorber_is_four_and_a_half_cells_wide_unless_it_says_otherwise(make: Make) -> None:
    assert choices.absorber(make()) is None
    assert choices.absorber(make(coupling__absorber={"rate": 1})).width == 18.0
    assert choices.absorber(make(coupling__absorber={"rate": 1, "width": 5})).width == 5.0


def test_the_rate_of_an_absorber_follows_from_the_shear_wave_along_the_normal(make: Make) -> None:
    """Of the slow shear wave of copper along [110] it would be too low."""
    assert choices.absorber(make(coupling__absorber={"rate": 3})).rate == 3.0
    case = make(coupling__absorber={})
    assert choices.absorber(case).rate == pytest.approx(1.55 * wave_speed(case, "S") / 4.0)
    stiffness = [[100, 60, 0], [60, 90, 0], [0, 0, 49]]
    material = {"from": "stiffness", "density": 1.0, "stiffness": stiffness}
    case = make(coupling__absorber={}, continuum__material=material)
    assert choices.absorber(case).rate == pytest.approx(1.55 * 7.0 / 4.0)
