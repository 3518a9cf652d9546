"""The laws of the materials of a case."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from gimpmd_gimp.laws import (
    AnisotropicElastic,
    CauchyBorn,
    J2Plasticity,
    LatticeSum,
    Law,
    LinearElastic,
    NeoHookean,
    make_law,
)
from gimpmd_schemas.case.materials import Material
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.hyperelastic import quadratic
from gimpmd_schemas.registry import collect
from tests.services.gimp.laws.sample_laws import any_stiffness, stress


def test_every_material_of_the_case_form_has_a_law() -> None:
    """And the case form knows every material of which a module makes a law."""
    assert set(collect("gimpmd_gimp.laws", "MATERIALS")) == set(get_args(Material))


def test_law_of_a_case_in_metal_units(build) -> None:
    """1 bar is 6.2415e-7 eV / A^3, and 1 eV is 9648.53 g/mol A^2 / ps^2."""
    material = {"from": "moduli", "density": 3.0, "lame": 2e5, "shear": 1e5}
    law = make_law(make_plan(build(units="metal", continuum={"material": material})))
    assert isinstance(law, LinearElastic)
    assert law.density == 3.0
    assert law.lame == pytest.approx(2e5 * 6.2415091e-7 * 9648.533, rel=1e-6)
    assert law.lame == pytest.approx(2 * law.shear)


def test_laws_of_the_materials_of_a_case(build) -> None:
    """One of every kind; in metal units a bar is 6.022e-3 g/mol / (A ps^2)."""
    bar = 6.2415091e-7 * 9648.533

    def law(**material: object) -> Law:
        case = build(units="metal", continuum={"material": {"density": 3.0} | material})
        return make_law(make_plan(case))

    moduli = {"from": "moduli", "lame": 2e5, "shear": 1e5}
    neo = law(**moduli, model="neo-hookean")
    assert isinstance(neo, NeoHookean)
    assert neo.shear == pytest.approx(1e5 * bar, rel=1e-6)
    plate = law(**moduli, plane="stress")
    assert isinstance(plate, LinearElastic)
    assert plate.lame == pytest.approx(1e5 * bar, rel=1e-6)  # 2 lame mu / (lame + 2 mu)
    C = any_stiffness(2)
    stiff = law(**{"from": "stiffness"}, stiffness=C.tolist())
    assert isinstance(stiff, AnisotropicElastic)
    np.testing.assert_allclose(stiff.stiffness, C * bar, rtol=1e-6)
    energy = {"coefficients": [1.0, 0.0, 0.0, 1.0, 0.0, 0.5], "strain_limit": 0.05}
    cauchy_born = law(**moduli | {"from": "hyperelastic"}, **energy)
    assert isinstance(cauchy_born, CauchyBorn)
    assert (cauchy_born.strain_limit, cauchy_born.dimension) == (0.05, 2)
    np.testing.assert_allclose(
        cauchy_born.coefficients, bar * np.array([1, 0, 0, 1, 0, 0.5]), rtol=1e-6
    )
    yields = {"yield_stress": 3e3, "hardening": 1e4}
    plastic = law(**moduli | {"from": "j2"}, **yields)
    assert isinstance(plastic, J2Plasticity)
    found = np.array([plastic.lame, plastic.shear, plastic.yield_stress, plastic.hardening])
    np.testing.assert_allclose(found, bar * np.array([2e5, 1e5, 3e3, 1e4]), rtol=1e-6)
    assert plastic.dimension == 2
    bonds = {"area": 2.0, "bonds": [[1.0, 0.0], [0.0, 1.0]], "energy": [[0.0, 1.0]] * 2}
    sums = law(**moduli | {"from": "lattice"}, **bonds, stretch_limit=0.1)
    assert isinstance(sums, LatticeSum)
    # C11 = 2 phi'' / A = 8 eV / (2 A^2), in g/mol / ps^2
    F = np.array([[[1.0 + 1e-7, 0.0], [0.0, 1.0]]])
    assert stress(sums, F)[0, 0, 0] == pytest.approx(4.0 * 9648.533 * 1e-7, rel=1e-6)
    assert {made.density for made in (neo, plate, stiff, cauchy_born, plastic, sums)} == {3.0}


def test_a_strain_energy_has_its_thermal_stress(build) -> None:
    """Per kelvin, in bar; 1 bar is 6.022e-3 g/mol / (A ps^2)."""
    material = {
        "from": "hyperelastic",
        "density": 3.0,
        "coefficients": quadratic(any_stiffness(2)).tolist(),
        "strain_limit": 0.03,
        "thermal_stress": [-60.0, -50.0, 3.0],
    }
    still = build(units="metal", continuum={"material": material})
    warm = build(units="metal", continuum={"material": material, "temperature": 300.0})
    at_rest = np.eye(2)[None]
    assert (stress(make_law(make_plan(still)), at_rest) == 0.0).all()
    bar = 6.2415091e-7 * 9648.533
    expected = 300.0 * bar * np.array([[-60.0, 3.0], [3.0, -50.0]])
    np.testing.assert_allclose(stress(make_law(make_plan(warm)), at_rest)[0], expected, rtol=1e-6)
