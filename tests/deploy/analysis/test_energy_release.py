"""Energy release rates from made-up energies, and the heat of made-up atoms."""

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_deploy.analysis.crack import Crack, CrackGrowth
from gimpmd_deploy.analysis.energy_release import (
    energy_release_rate,
    rate_per_advance,
    thermal_motion,
)
from gimpmd_deploy.analysis.plane import Plane
from tests.deploy.analysis.fields import SPACING, hexagonal, particles

PLANE = Plane.through((0, 0), (1, 0))
CRACK = Crack(PLANE, 10.0)
SITES = hexagonal(((0, 60), (-30, 30)))
RESISTANCE, SPEED, AREA, DENSITY = 2.18, 2.0, SPACING**2 * 0.75**0.5, 0.93
TIME = np.arange(0.0, 40.5, 1.0)


def length(time):
    return 10.0 + SPEED * (np.clip(time, 10.0, 30.0) - 10.0)


def growth(time=TIME):
    """The tip is known to half an atom."""
    steps = np.floor(length(time) / (0.5 * SPACING)) * 0.5 * SPACING
    return CrackGrowth(time, steps, np.zeros((time.size, 2)), SPACING)


def test_the_slope_over_the_length():
    rates = rate_per_advance(growth(), 3.0 * length(TIME), 8.0)
    moving = (TIME > 14.0) & (TIME < 26.0)
    assert rates[moving] == pytest.approx(3.0, rel=0.03)
    assert np.isnan(rates[(TIME < 6.0) | (TIME > 34.0)]).all()


def hot(temperature, time=0.0):
    """Atoms in linear motion, faces that move apart, and random velocities."""
    random = np.random.default_rng(8).standard_normal(SITES.shape)
    v = SITES @ np.array([[0.01, 0.02], [-0.01, 0.03]]) + (1.0, -2.0)
    v[:, 1] += 0.5 * np.sign(SITES[:, 1])
    return particles(SITES, v=v + np.sqrt(temperature) * random, time=time)


@pytest.mark.parametrize("temperature", [0.0, 0.01])
def test_thermal_motion_leaves_out_the_motion_of_the_body(temperature):
    """The kinetic energy of ``n`` atoms of mass one is ``n k T`` in two dimensions."""
    found = thermal_motion(hot(temperature), PLANE)
    assert found == pytest.approx(len(SITES) * temperature, rel=0.04, abs=1e-20)


def made_up_run(wave_rate, heat_rate):
    """A body that releases energy as new surface, waves and heat, and balances its energy."""
    grown = length(TIME) - length(TIME[0])
    surface, waves, heat = RESISTANCE * grown, wave_rate * grown, heat_rate * grown
    elastic = 100.0 - 3.0 * grown
    potential, kinetic = elastic + surface + 0.5 * heat, waves + 0.5 * heat
    energies = SimpleNamespace(
        time=TIME,
        potential=potential,
        kinetic=kinetic,
        external_work=potential + kinetic - 100.0,
        dissipated=np.zeros(TIME.size),
    )
    per_atom = heat / len(SITES) / DENSITY / AREA  # k T over the mass, from n k T each half
    return SimpleNamespace(
        energies=energies,
        plan=SimpleNamespace(
            units="lj",
            continuum=SimpleNamespace(material=SimpleNamespace(density=DENSITY)),
        ),
        atoms_file=SimpleNamespace(lattice=(SPACING, AREA)),
        atoms=lambda t: hot(0.5 * per_atom[round(t)], t),
    )


def test_rates_of_a_crack_that_makes_waves_and_heat():
    found = energy_release_rate(made_up_run(0.8, 0.3), growth(), RESISTANCE, 8.0, crack=CRACK)
    moving = (TIME > 14.0) & (TIME < 26.0)
    # heat takes half of its energy from the elastic energy that is left
    assert found.static[moving] == pytest.approx(RESISTANCE + 0.8 + 0.15, rel=0.03)
    assert found.dynamic[moving] == pytest.approx(RESISTANCE + 0.3, rel=0.03)
    assert np.isnan(found.static[0])
    assert list(found.to_dataframe()) == ["time", "length", "static", "dynamic", "resistance"]
