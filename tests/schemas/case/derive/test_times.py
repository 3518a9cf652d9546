"""Time steps, and the steps with energies and output."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from gimpmd_schemas.case.derive import material, times, zones
from gimpmd_schemas.case.form import Case

Make = Callable[..., Case]


@pytest.mark.parametrize(
    ("end", "expected"), [(8, 100), (8.0001, 101), (0.079, 1), (0.08, 1), (0.0801, 2), (0.24, 3)]
)
def test_the_last_step_reaches_or_passes_the_end(make: Make, end: float, expected: int) -> None:
    case = make(time__end=end)
    assert times.steps(case) == expected
    assert times.steps(case) * times.step(case) >= end * (1 - 1e-9)
    assert (times.steps(case) - 1) * times.step(case) < end


def test_temporal_factor_of_the_paper(make: Make) -> None:
    """Ma et al. section 5.1: L = 4, dt = 0.002; Eq. 17 with the 2D modulus of their lattice."""
    case = make(
        time__md_steps="auto",
        continuum__material={"from": "moduli", "density": 0.9165, "lame": 24.745, "shear": 24.745},
    )
    speed = math.sqrt(65.987 / 0.9165)  # sqrt(E / rho) of PHYSICS: E = 65.987
    assert material.wave_speed(case, "bar") == pytest.approx(speed, rel=1e-4)
    assert times.md_steps(case) == round(0.1 * 4 / speed / 0.002)


def test_step_without_atoms(make: Make) -> None:
    alone = {"md": ..., "only": "continuum"}
    case = make(**alone, time={"end": 8}, grid__levels=[{"boxes": [[[16, 40], [16, 40]]]}])
    assert times.step(case) * material.wave_speed(case, "P") / 2.0 == pytest.approx(0.4)
    assert times.step(make(**alone, time={"end": 8, "step": 0.1})) == 0.1
    assert times.step(make(only="continuum")) == 0.08  # of a coupled case: N dt_MD
    assert zones.zones(case).regions[0].box == case.domain.box
    for ask in (lambda: case.atoms, lambda: times.md_timestep(case)):
        with pytest.raises(ValueError, match="no "):
            ask()


def test_output_interval_in_steps(make: Make) -> None:
    assert times.output_every(make(output__interval=1)) == 12  # 12.5 steps of 0.08
    assert times.output_every(make(output__interval=0.01)) == 1


@pytest.mark.parametrize(
    ("end", "wanted", "every", "steps"),
    [
        (1.0, None, 1, 13),  # of 0.08
        (80.0, None, 5, 1000),
        (80.0, 0.56, 5, 1000),  # seven do not end there, six neither
        (80.08, None, 5, 1005),  # 1001 is 7 x 11 x 13
        (80.0, 0.01, 1, 1000),
        (80.0, 1e6, 1000, 1000),
    ],
)
def test_energies_are_those_of_the_end_too(
    make: Make, end: float, wanted: float | None, every: int, steps: int
) -> None:
    case = make(time__end=end, output__energy_interval=wanted)
    assert (times.energies_every(case), times.steps(case)) == (every, steps)


def test_energies_are_those_of_common_times(make: Make) -> None:
    refined = [{"boxes": [[[0, 32], [8, 40]]]}, {"boxes": [[[0, 24], [16, 32]]]}]
    case = make(time__end=80.0, output__energy_interval=0.7, grid__levels=refined)
    assert (times.energies_every(case), times.steps(case)) == (8, 1000)
