"""Choices of a method that fit together, and those that do not."""

from __future__ import annotations

from typing import get_args

import pytest

from gimpmd_gimp.grid.clock import Integrator
from gimpmd_gimp.points.body import Interpolation, Placement
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method

BETA = correction(0.25)


def test_domains_that_stretch_are_refused():
    Method(interpolation="cpgimp", configuration="current")
    with pytest.raises(ValueError, match="use ugimp"):
        Method(interpolation="cpgimp", configuration="reference")


@pytest.mark.parametrize(
    "changes",
    [
        {"configuration": "current"},
        {"integrator": "usavg"},
        {"interpolation": "bspline"},
        {"dispersion": -0.1},
    ],
)
def test_schemes_that_cannot_be_corrected_are_refused(changes):
    sound = {"integrator": "musl", "configuration": "reference", "dispersion": BETA}
    Method(**sound)
    with pytest.raises(ValueError, match="dispersion correction"):
        Method(**(sound | changes))


@pytest.mark.parametrize("interpolation", ["ugimp", "linear"])
def test_a_corrected_body_needs_its_finer_time_steps_in_a_wider_band(interpolation) -> None:
    plain = Method("musl", interpolation, configuration="reference")
    corrected = Method("musl", interpolation, configuration="reference", dispersion=BETA)
    assert plain.placement == Placement("reference", interpolation, corrected=False)
    assert corrected.placement == Placement("reference", interpolation, corrected=True)


def test_all_other_choices_fit_together() -> None:
    for integrator in get_args(Integrator):
        for interpolation in get_args(Interpolation):
            method = Method(integrator, interpolation)
            assert method.placement == Placement("current", interpolation)
    assert set(get_args(Integrator)) == set(INTEGRATORS)
