"""How strips are cut from the crystal of a case."""

from __future__ import annotations

import math

import pytest

from gimpmd_deploy.verify.strips import MISFIT, Axis, Travel, Wave, fitted
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.derive.material import wave_speed
from tests.deploy.verify.crystal import HEXAGONAL, IN_SPACE, ground


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("period", [HEXAGONAL, (3.0, 3.9), (9.1, 17.3), (2.0, 4.0)])
def test_strips_repeat_with_cells_hardly_smaller_than_the_cases(
    period: tuple[float, float], axis: Axis
) -> None:
    cut = ground(period, axis)
    assert (1 - MISFIT) * 4.0 <= cut.cell <= 4.0
    (across,) = cut.across
    periods = across * cut.cell / period[1 - axis]
    assert periods == pytest.approx(round(periods), abs=1e-9)


@pytest.mark.parametrize(
    ("periods", "counts"),
    [((3.9, 3.9), (2, 2)), ((3.9, 1.3), (2, 2)), ((2.6, 3.9), (2, 2)), ((5.2, 3.9), (4, 2))],
)
def test_cells_fit_two_periods_at_once(
    periods: tuple[float, float], counts: tuple[int, int]
) -> None:
    cell, found = fitted(4.0, periods)
    assert cell == pytest.approx(3.9)
    assert found == counts


def test_no_cell_fits_periods_without_a_common_multiple() -> None:
    """The face {110} of a cubic crystal."""
    with pytest.raises(ValueError, match="fits all periods"):
        fitted(4.0, (1.3, 1.3 * math.sqrt(2.0)))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("travel", ["into", "out"])
def test_strips_in_space_are_sound_cases(axis: Axis, travel: Travel) -> None:
    cut = ground((1.3, 1.3, 1.3), axis, **IN_SPACE)
    case = cut.strip(Wave(8.0, "S"), travel)
    assert check_case(case) == []
    assert [not periodic for periodic in case.domain.periodic] == [k == axis for k in range(3)]
    for k, (low, high) in enumerate(case.domain.box):
        if k != axis:
            assert (high - low) == pytest.approx(2 * cut.cell)


@pytest.mark.parametrize("travel", ["into", "out"])
def test_packets_start_as_far_from_the_plane_as_from_an_interface(travel: Travel) -> None:
    """Planes lie inside the region: of two planes the deeper one counts."""
    planes = {"right": 48.0}  # of a region that ends at 60
    coupling = {"coupling": {"scheme": "force", "planes": planes}}
    cut, bare = ground(HEXAGONAL, **coupling), ground(HEXAGONAL)
    assert cut.depth * cut.cell == pytest.approx(12.0)
    case, other = cut.strip(Wave(8.0), travel), bare.strip(Wave(8.0), travel)
    assert case.domain == other.domain
    assert case.initial == other.initial
    assert other.atoms.region[0][0] - case.atoms.region[0][0] == pytest.approx(12.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("travel", ["into", "out"])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_strips_are_sound_cases(axis: Axis, travel: Travel, degrees: float) -> None:
    cut = ground(HEXAGONAL, axis)
    wave = Wave(8.0, "S") if not degrees else cut.oblique(8.0, "S", degrees)
    case = cut.strip(wave, travel)
    assert check_case(case) == []
    (start, end), packet = case.domain.box[axis], case.initial.packets[0]
    interface = case.atoms.region[axis][0]
    # the packet starts and ends wholly on one side: 2.5 wavelengths hold it
    far = abs(packet.center - interface)
    assert far == pytest.approx(2.5 * 8.0 * cut.cell)
    assert min(interface - start, end - interface) >= 2.0 * far
    way = case.time.end * wave_speed(case, "S") * math.cos(math.radians(wave.degrees))
    assert way >= 2.0 * far
    # what is across repeats: whole periods of crystal, one wave
    low, high = case.domain.box[1 - axis]
    assert (high - low) / cut.crystal.period[1 - axis] == pytest.approx(
        round((high - low) / cut.crystal.period[1 - axis]), abs=1e-9
    )
    if degrees:
        assert 25.0 < wave.degrees < 35.0
        waves = (high - low) * math.sin(math.radians(packet.tilt)) / packet.wavelength
        assert waves == pytest.approx(1.0)


def test_strips_of_a_warm_case_are_cold() -> None:
    """Thermal stress would set them in motion, and noise is larger than any packet."""
    bath = {"rate": 2.0, "width": 8.0, "temperature": 0.05}
    warm = {"continuum.temperature": 0.05, "coupling.scheme": "force", "coupling.absorber": bath}
    case = ground(HEXAGONAL, **warm).strip(Wave(8.0), "out")
    assert case.continuum.temperature is None
    assert case.coupling.absorber is not None
    assert (case.coupling.absorber.rate, case.coupling.absorber.temperature) == (2.0, 0.0)


def test_a_long_oblique_wave_stays_below_grazing() -> None:
    cut = ground(HEXAGONAL)
    for degrees in (5.0, 30.0, 60.0, 89.0):
        wave = cut.oblique(3.0, "P", degrees)
        assert 0.0 < wave.degrees < 90.0
