"""Fields of particles by name."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_deploy.results.fields import describe, field_names, field_values, von_mises
from gimpmd_schemas.case.checks.figures import figure_fields
from tests.deploy.figures.three_d import lattice


def test_a_case_may_ask_for_the_fields_of_its_runs(block):
    found = {name for p in block.particles(0.8).values() for name in field_names(p, "lj")}
    assert found == set(figure_fields(2)) - {"equivalent_plastic_strain"}  # of j2 only


@pytest.mark.parametrize("dim", [2, 3])
def test_components(dim):
    p = lattice(1.0, ((0.0, 3.0),) * dim)
    p.velocity[:] = np.arange(3.0)[:dim] + 1.0
    p.stress[:] = np.arange(float(p.stress.shape[1]))
    pairs = {2: ["xx", "yy", "xy"], 3: ["xx", "yy", "zz", "yz", "xz", "xy"]}[dim]
    for k, pair in enumerate(pairs):
        assert field_values(p, f"sigma_{pair}", "lj")[0] == k
    assert field_values(p, "velocity_y", "lj")[0] == 2.0
    assert field_values(p, "speed", "lj")[0] == pytest.approx({2: 5.0, 3: 14.0}[dim] ** 0.5)
    assert field_values(p, "pressure", "lj")[0] == {2: -0.5, 3: -1.0}[dim]
    assert field_values(p, "temperature", "lj") is None


def test_von_mises_stress():
    """A shear stress counts by the square root of 3; pressure does not count in space."""
    uniaxial, shear = [[2.0, 0.0, 0.0]], [[0.0, 0.0, 2.0]]
    assert von_mises(np.array(uniaxial))[0] == pytest.approx(2.0)
    assert von_mises(np.array(shear))[0] == pytest.approx(2.0 * 3.0**0.5)
    space = np.array([[5.0, 3.0, 3.0, 0.0, 0.0, 0.0], [4.0, 4.0, 4.0, 0.0, 2.0, 0.0]])
    np.testing.assert_allclose(von_mises(space), [2.0, 2.0 * 3.0**0.5])


@pytest.mark.parametrize(
    ("name", "symbol", "quantity", "kind"),
    [
        ("sigma_xy", r"$\sigma_{xy}$", "pressure", "signed"),
        ("displacement_x", "$u_{x}$", "length", "signed"),
        ("strain_xx", r"$\varepsilon_{xx}$", "", "signed"),
        ("plastic_strain_xy", r"$\gamma^p_{xy}$", "", "signed"),
        ("speed", "speed", "velocity", "positive"),
        ("some_history", "some history", "", "any"),
    ],
)
def test_labels(name, symbol, quantity, kind):
    field = describe(name)
    assert (field.symbol, field.quantity, field.kind) == (symbol, quantity, kind)


def test_energy_density_of_points_is_energy_per_volume():
    """Points hold it in pressure units: 1 eV / A^3 is 1.602 Mbar."""
    p = lattice(1.0, ((0.0, 3.0),) * 3)
    p.fields["strain_energy"] = np.full(len(p), 1.6021765e6)
    np.testing.assert_allclose(field_values(p, "energy_density", "metal"), 1.0)
