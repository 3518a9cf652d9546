"""An MD region in a corner of the body: two interfaces that meet, and two faces of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.form import FACES
from tests.physics.interface.schemes import SCHEMES, SchemeName, coupled
from tests.physics.strips import H, broadband_case, energies, run_case, strain_error

BODY = (30, 22)
REGION = ((0.0, 13.3), (0.0, 10.4))
"""In cells; the interfaces lie on no node lines."""


def corner(scheme: SchemeName, end: float) -> dict[str, Any]:
    """A body that repeats along no axis, its faces free and its waves those of the strip."""
    case = coupled(broadband_case(end, md_steps=16, md_timestep=0.005), scheme)
    case["name"] = "corner"
    case["domain"] = {"box": [[0.0, n * H] for n in BODY], "periodic": [False, False]}
    case["md"]["region"] = [[low * H, high * H] for low, high in REGION]
    case["boundary"] = {}
    return case


@pytest.mark.long
@pytest.mark.parametrize(
    ("scheme", "size"), [("force", 1e-3), ("force", 2.5e-4), ("velocity", 1e-3)]
)
def test_uniform_strain_is_held(scheme: SchemeName, size: float, tmp_path: Path) -> None:
    """Between held faces, two of which are the atoms'; as the gate "held strain" of a strip.

    Rods of the force scheme hold small strains at corners; the rest is of second order.
    """
    case = corner(scheme, 24.0)
    held = {"condition": "velocity", "value": [0.0, 0.0]}
    case["boundary"] = dict.fromkeys(FACES[:4], held)
    G = size * np.array([[1.0, 0.5], [0.0, -0.5]])
    case["initial"] = {"stretch": {"gradient": G.tolist()}}
    run = run_case(case, tmp_path)
    assert strain_error(run) < (size**2 if scheme == "force" else 1e-7)
    assert abs(sum(energies(run)) - 1.0).max() < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["force", "velocity"])
def test_energy_of_oblique_waves(scheme: SchemeName, tmp_path: Path) -> None:
    """Waves of 4 to 10 cells among free faces cross both interfaces and their corner."""
    case = corner(scheme, 40.0)
    case["md"]["minimize"] = True  # free surfaces of the crystal are not at rest
    for packet in case["initial"]["packets"]:
        packet["tilt"] = 35.0
    run = run_case(case, tmp_path)
    total, most = sum(energies(run)), SCHEMES[scheme].broadband
    assert total.max() < 1.0 + most
    if scheme == "force":
        assert total.min() > 1.0 - most
