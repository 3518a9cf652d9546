"""What the sums of a side may be in a sound run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.plausibility import (
    GAIN,
    INITIAL_STRAIN,
    SPEED,
    Plausibility,
    strain_energy,
)
from tests.cases import BAR, changed

MASS, C2 = 64.0, 1.0
"""Mass of the bar, and its squared wave speed."""


def plan(**changes: Any) -> Plan:
    return make_plan(msgspec.convert(changed(BAR, changes), Case))


def energies(**values: Any) -> Energies:
    known = dict.fromkeys(
        ("kinetic", "potential", "external_work", "interface_work", "dissipated"), 0.0
    )
    return Energies(**known | {"mass": MASS, "momentum": (0.0, 0.0)} | values)


@pytest.fixture
def look() -> Callable[[Energies], list[str]]:
    """Kinds of the findings about a side that was at rest at the start."""
    monitor = Plausibility(plan())
    assert monitor.look(energies()) == ()
    return lambda side: [finding.kind for finding in monitor.look(side)]


def test_a_side_at_rest_with_work_done_on_it(look) -> None:
    assert look(energies(kinetic=1e-2, potential=1e-2, external_work=2e-2)) == []


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_energy_without_a_source(look, share: float) -> None:
    """Beyond the work and the energy at a strain of 1e-4, which is small beside it."""
    explained = 0.5 + 0.5 * MASS * C2 * 1e-8
    side = energies(potential=0.5 + share * GAIN * explained, external_work=0.5)
    assert look(side) == (["energy"] if share > 1.0 else [])


@pytest.mark.parametrize("source", ["external_work", "fix_work", "interface_work"])
def test_all_sources_count(look, source: str) -> None:
    assert look(energies(potential=0.5)) == ["energy"]
    assert look(energies(potential=0.5, **{source: 0.5})) == []
    assert look(energies(potential=-0.5, **{source: -0.5})) == []


def test_energy_that_an_absorber_gives_back(look) -> None:
    assert look(energies(potential=0.5, dissipated=-0.5)) == []


def test_a_loss_is_no_finding(look) -> None:
    assert look(energies(external_work=1.0)) == []


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_speed_about_the_mean_velocity(share: float) -> None:
    monitor, flight = Plausibility(plan()), 5.0
    kinetic = 0.5 * MASS * ((share * SPEED) ** 2 * C2 + flight**2)
    side = energies(kinetic=kinetic, momentum=(0.0, MASS * flight))
    assert [f.kind for f in monitor.look(side)] == (["speed"] if share > 1.0 else [])


def test_lost_mass(look) -> None:
    assert look(energies(mass=MASS * (1.0 - 1e-12))) == []
    assert look(energies(mass=MASS - 1e-5)) == ["mass"]


def test_an_empty_side(look) -> None:
    assert Plausibility(plan()).look(energies(mass=0.0)) == ()


def test_energies_are_in_the_units_of_the_case() -> None:
    """``metal``: mass in g/mol, speed in A/ps, energy in eV."""
    one = plan(units="metal")
    square = one.wave_speed("P") ** 2
    energy = strain_energy(one, MASS, INITIAL_STRAIN)
    expected = 0.5 * MASS * square * INITIAL_STRAIN**2 * UNITS["metal"].mvv2e
    assert energy == pytest.approx(expected)


def test_it_goes_on_from_its_state() -> None:
    """With the start and the energy explained so far of the run that was interrupted."""
    first, second = Plausibility(plan()), Plausibility(plan())
    assert first.state().size == 0
    first.look(energies())
    first.look(energies(potential=1.0, external_work=1.0))
    second.restore(first.state())
    for monitor in (first, second):
        assert monitor.look(energies(potential=0.9 * GAIN)) == ()
        assert [f.kind for f in monitor.look(energies(mass=1.0))] == ["mass"]
