"""Local temperature of atoms with velocities of a known temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.temperature import WIDTH, local_temperature
from gimpmd_schemas.mechanics.units import UNITS
from tests.deploy.figures.three_d import lattice


def gas(box, mass, temperature, units="lj") -> Particles:
    """Atoms on a square lattice with Maxwell's velocities, of two masses."""
    atoms = lattice(1.0, box)
    m = np.where(np.arange(len(atoms)) % 2, mass, 2.0 * mass)
    style = UNITS[units]
    width = np.sqrt(style.boltz * temperature / style.mvv2e / m)
    v = np.random.default_rng(3).normal(size=atoms.velocity.shape) * width[:, None]
    return replace(atoms, velocity=v, fields={"mass": m})


@pytest.mark.parametrize(("units", "mass", "kelvin"), [("lj", 1.0, 0.3), ("metal", 63.5, 300.0)])
@pytest.mark.parametrize("dim", [2, 3])
def test_temperature_of_moving_atoms(dim, units, mass, kelvin):
    """The motion of the whole does not count; the mean is exact but for chance."""
    atoms = gas(((0.0, {2: 80.0, 3: 18.0}[dim]),) * dim, mass, kelvin, units)
    atoms.velocity[:, 0] += 40.0 * np.sqrt(UNITS[units].boltz * kelvin / UNITS[units].mvv2e / mass)
    found = local_temperature(atoms, units)
    error = 3.0 * np.sqrt(2.0 / (dim * len(atoms)))
    assert found.mean() == pytest.approx(kelvin, rel=error)
    neighbours = (4.0 * np.pi * WIDTH**2) ** (0.5 * dim)
    assert found.std() < 2.0 * kelvin * np.sqrt(2.0 / (dim * neighbours))


def test_a_hot_half():
    atoms = gas(((0.0, 80.0), (0.0, 80.0)), 1.0, 0.5)
    cold = atoms.position[:, 0] < 40.0
    atoms.velocity[cold] = 0.0
    found = local_temperature(atoms, "lj")
    assert found[atoms.position[:, 0] < 40.0 - 5.0 * WIDTH].max() == 0.0
    assert found[atoms.position[:, 0] > 40.0 + 5.0 * WIDTH].mean() == pytest.approx(0.5, rel=0.06)


def test_a_single_atom_has_no_temperature():
    atoms = gas(((0.0, 1.0), (0.0, 1.0)), 1.0, 0.5)
    np.testing.assert_allclose(local_temperature(atoms, "lj"), 0.0, atol=1e-12)
