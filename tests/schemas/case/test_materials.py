"""Materials: cases that break a rule or just keep it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    BLOCK,
    MEASURED,
    SLANTED,
    STIFF,
    Break,
    anisotropic,
    assert_breaks,
    assert_keeps,
    bonded,
    crystal,
    fitted,
    material,
    plastic,
)

TABLE = b64encode(np.ones(5).tobytes()).decode()
EMBEDDED = {
    "from": "embedded",
    "density": 0.93,
    "stiffness": np.eye(6).tolist(),
    "volume": 1.0,
    "bonds": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "cutoff": 1.4,
    "distance_step": 0.3,
    "density_step": 0.3,
    "pair": TABLE,
    "cloud": TABLE,
    "embedding": TABLE,
}

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("continuum.material.density", {"continuum__material": material(density=0)}, "positive"),
    ("continuum.material.shear", {"continuum__material": material(shear=0)}, "positive"),
    ("continuum.material.lame", {"continuum__material": material(lame=-27.8)}, "must exceed"),
    (
        "continuum.material.strain_limit",
        {"continuum__material": crystal(strain_limit=0)},
        "positive",
    ),
    (
        "continuum.material.coefficients",
        {"continuum__material": crystal(coefficients=[1.0] * 15)},
        "not those of a polynomial in 3 strains",
    ),
    ("continuum.material.model", fitted(model="lattice-sum"), "is for three dimensions"),
    (
        "continuum.material.degree",
        BLOCK | fitted(model="lattice-sum", degree=4),
        "is that of model: cauchy-born",
    ),
    ("continuum.material.from", {"continuum__material": EMBEDDED}, "is for three dimensions"),
    (
        "continuum.material.cutoff",
        BLOCK | {"continuum__material": EMBEDDED | {"cutoff": 0}},
        "must be positive",
    ),
    (
        "continuum.material.pair",
        BLOCK | {"continuum__material": EMBEDDED | {"pair": "AAAA"}},
        "are no table",
    ),
    (
        "continuum.material.bonds",
        BLOCK | {"continuum__material": EMBEDDED | {"bonds": [[0, 0, 0]]}},
        "nonzero length",
    ),
    (
        "continuum.material.stiffness",
        BLOCK | {"continuum__material": EMBEDDED | {"stiffness": STIFF}},
        "6 rows of 6 numbers",
    ),
    ("continuum.material.degree", BLOCK | fitted(degree=2), "must lie between 3 and 6"),
    ("continuum.material.degree", fitted(degree=4), "in three dimensions"),
    ("continuum.material.strain_limit", BLOCK | fitted(strain_limit=0.2), "between 0.005 and 0.1"),
    (
        "continuum.material.strain_limit",
        BLOCK | fitted(model="linear", strain_limit=0.02),
        "is that of model: cauchy-born",
    ),
    (
        "continuum.material.shear",
        {"continuum__material": crystal(shear=None)},
        "belong together",
    ),
    (
        "continuum.material.coefficients",
        {"continuum__material": crystal(lame=None, shear=None, coefficients=[-1.0] * 16)},
        "must be positive definite; its smallest eigenvalue is",
    ),
    (
        "continuum.material.thermal_stress",
        {"continuum__material": crystal(thermal_stress=[1.0])},
        "must have 3 numbers",
    ),
    (
        "continuum.material.lame",
        BLOCK | {"continuum__material": material(lame=-20)},
        "must exceed -18.5333, minus 2/3",
    ),
    (
        "continuum.material.lame",
        {"continuum__material": material(lame=-20, plane="stress")},
        "must exceed -18.5333",
    ),
    ("continuum.material.plane", BLOCK | {"continuum__material": material(plane="stress")}, "two"),
    (
        "continuum.material.plane",
        {"continuum__material": material(plane="stress", model="neo-hookean")},
        "linear elasticity only",
    ),
    (
        "continuum.material.shear",
        {"continuum__material": crystal(shear=0)},
        "must be positive",
    ),
    ("continuum.material.yield_stress", plastic(yield_stress=0), "must be positive"),
    ("continuum.material.hardening", plastic(hardening=-1e-3), "must not be negative"),
    ("continuum.material.lame", plastic(lame=-20), "must exceed -18.5333, minus 2/3"),
    ("continuum.material.density", plastic(density=0), "must be positive"),
    ("continuum.material.shear", plastic(shear=-1), "must be positive"),
    (
        "continuum.temperature",
        plastic() | {"continuum__temperature": 1.0},
        "needs the thermal stress",
    ),
    ("continuum.material.stiffness", anisotropic(STIFF[:2]), "3 rows of 3 numbers"),
    ("continuum.material.stiffness", BLOCK | anisotropic(STIFF), "6 rows of 6 numbers"),
    ("continuum.material.stiffness", anisotropic([[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
    ("continuum.material.stiffness", anisotropic([[1, 2, 0], [2, 1, 0], [0, 0, 1]]), "definite"),
    ("continuum.material.stiffness", anisotropic([[0, 0, 0]] * 3), "definite"),
    (
        "continuum.material.thermal_stress",
        anisotropic(STIFF, thermal_stress=[-1.0]),
        "must have 3 numbers in 2 dimensions",
    ),
    (
        "continuum.temperature",
        anisotropic(STIFF) | {"continuum__temperature": 1.0},
        "needs the thermal stress",
    ),
    ("continuum.material.area", bonded(area=0), "must be positive"),
    ("continuum.material.stretch_limit", bonded(stretch_limit=-0.1), "must be positive"),
    ("continuum.material.shear", bonded(shear=0), "must be positive"),
    ("continuum.material.bonds", bonded(bonds=[[1, 0], [0, 0]]), "nonzero length"),
    ("continuum.material.bonds", bonded(bonds=[], energy=[]), "nonzero length"),
    ("continuum.material.energy", bonded(energy=[[0, 1]]), "for each of 2 bonds"),
    ("continuum.material.energy", bonded(energy=[[0, 1], []]), "for each of 2 bonds"),
    ("continuum.material.from", BLOCK | bonded(), "two dimensions only"),
    ("continuum.temperature", bonded() | {"continuum__temperature": -1}, "must not be negative"),
    ("continuum.temperature", {"continuum__temperature": 0.05}, "needs the thermal stress"),
    (
        "continuum.temperature",
        {"continuum__material": MEASURED, "continuum__temperature": 0.05},
        "needs the thermal stress",
    ),
    (
        "continuum.temperature",
        {"continuum__material": crystal(), "continuum__temperature": 0},
        "needs the thermal stress",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"continuum__material": material(lame=-27.79)},
    bonded(),
    {"continuum__material": MEASURED | {"model": "cauchy-born"}, "continuum__temperature": 0.05},
    anisotropic(STIFF, thermal_stress=[-9.0, -9.0, 0.0]) | {"continuum__temperature": 0.05},
    BLOCK,
    {"only": "continuum", "domain__box": [[0, 120], [0, 80], [0, 8]]}
    | {"md__region": [[0, 80], [20, 60], [0, 8]]},
    BLOCK | {"continuum__material": material(lame=-18.5)},
    {"continuum__material": material(plane="stress")},
    {"continuum__material": material(model="neo-hookean")},
    {"continuum__material": crystal()},
    {"continuum__material": crystal(thermal_stress=[-1, -1, 0]), "continuum__temperature": 0.05},
    {
        "continuum__material": crystal(
            lame=None, shear=None, coefficients=[1, 0.5, 0, 1, 0, 1, *[9.0] * 10]
        )
    },
    BLOCK | fitted(),
    BLOCK | fitted(model="lattice-sum"),
    BLOCK | {"continuum__material": EMBEDDED},
    BLOCK | fitted(degree=6, strain_limit=0.05) | {"continuum__temperature": 0.05},
    anisotropic(STIFF),
    ALONE | anisotropic(SLANTED),
    plastic(hardening=0),
    BLOCK | plastic(lame=-18.5),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))
