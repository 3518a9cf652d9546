"""Stiffness and wave speeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.derive import material
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.mechanics.hyperelastic import quadratic

Make = Callable[..., Case]


def test_wave_speeds_are_those_of_the_lattice(make: Make) -> None:
    case = make(
        continuum__material={
            "from": "moduli", "density": 0.9317984, "lame": 27.8332, "shear": 27.8332,
        }
    )  # fmt: skip
    assert material.wave_speed(case, "P") == pytest.approx(9.4663, abs=1e-4)
    assert material.wave_speed(case, "S") == pytest.approx(5.4654, abs=1e-4)


def test_wave_speed_needs_the_moduli(make: Make) -> None:
    case = make(continuum__material={"from": "md", "cell": "cell.in"})
    with pytest.raises(ValueError, match="not been measured"):
        material.wave_speed(case, "P")


def test_wave_speeds_of_materials(make: Make) -> None:
    """Textbook formulas for E = 200, nu = 0.25, rho = 2 (lambda = mu = 80)."""
    young, nu, rho = 200.0, 0.25, 2.0
    given = {"from": "moduli", "density": rho, "lame": 80.0, "shear": 80.0}
    block = {"only": "continuum", "domain__box": [[0, 40]] * 3}

    def speeds(**changes: Any) -> list[float]:
        case = make(**changes)
        return [rho * material.wave_speed(case, kind) ** 2 for kind in ("P", "S", "bar")]

    strain = young * (1 - nu) / (1 + nu) / (1 - 2 * nu)
    assert speeds(continuum__material=given) == pytest.approx([strain, 80, young / (1 - nu**2)])
    sheet = given | {"plane": "stress"}
    assert speeds(continuum__material=sheet) == pytest.approx([young / (1 - nu**2), 80, young])
    assert speeds(continuum__material=given, **block) == pytest.approx([strain, 80, young])
    crystal = given | {"from": "hyperelastic", "coefficients": [], "strain_limit": 0.06}
    assert speeds(continuum__material=crystal) == speeds(continuum__material=given)
    plastic = given | {"from": "j2", "yield_stress": 0.1}
    assert speeds(continuum__material=plastic) == speeds(continuum__material=given)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_stiffness_of_an_isotropic_material_gives_its_speeds(make: Make, dim: int) -> None:
    box = {"only": "continuum", "domain__box": [[0, 40]] * dim}
    case = make(**box)
    tensor = {"from": "stiffness", "density": 0.93, "stiffness": material.stiffness(case).tolist()}
    same = make(**box, continuum__material=tensor)
    for kind in ("P", "S", "bar"):
        expected = material.wave_speed(case, kind)
        assert material.wave_speed(same, kind) == pytest.approx(expected, rel=1e-12)


def test_cubic_crystal(make: Make) -> None:
    """Copper, C11 = 168.4, C12 = 121.4, C44 = 75.4 GPa: along [100] 4.34 and 2.90 km/s.

    E along [100] is (C11 - C12)(C11 + 2 C12) / (C11 + C12) = 66.7 GPa (Nye).
    """
    matrix = np.diag([168.4 - 121.4] * 3 + [75.4] * 3)
    matrix[:3, :3] += 121.4
    given = {"from": "stiffness", "density": 8960, "stiffness": (matrix * 1e9).tolist()}
    box = {"only": "continuum", "domain__box": [[0, 40]] * 3}
    case = make(units="si", continuum__material=given, **box)
    assert material.wave_speed(case, "P") == pytest.approx(4340, rel=2e-3)
    assert material.wave_speed(case, "S") == pytest.approx(2900, rel=2e-3)
    assert material.wave_speed(case, "bar") == pytest.approx((66.7e9 / 8960) ** 0.5, rel=2e-3)


def test_a_strain_energy_without_moduli_has_the_speeds_of_its_stiffness(make: Make) -> None:
    matrix = np.diag([47.0] * 3 + [75.4] * 3)
    matrix[:3, :3] += 121.4
    box = {"only": "continuum", "domain__box": [[0, 40]] * 3}
    linear = {"from": "stiffness", "density": 8.96, "stiffness": matrix.tolist()}
    energy = {
        "from": "hyperelastic",
        "density": 8.96,
        "coefficients": quadratic(matrix).tolist(),
        "strain_limit": 0.03,
    }
    same, other = (make(**box, continuum__material=given) for given in (linear, energy))
    np.testing.assert_array_equal(material.stiffness(other), matrix)
    for kind in ("P", "S", "bar"):
        assert material.wave_speed(other, kind) == material.wave_speed(same, kind)
    assert material.slowest_speed(other, 0) == material.slowest_speed(same, 0)
