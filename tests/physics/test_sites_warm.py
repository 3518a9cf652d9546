"""Thermal expansion with the sites scheme: atoms and continuum of a warm strip with free ends.

The strip repeats along the other axes, so it expands along x alone. What it should do follows from
lattice dynamics.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.materials import Anisotropic
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import COPPER, H, copper_case, write_scripts
from tests.physics.interface.expansion import SETTLED, expansion, mean_displacement, slope
from tests.physics.strips import energies, run_in

TEMPERATURE, END = 100.0, 40.0
"""Temperature (K) and time (ps)."""

START = 3.67e-3
"""Strain at the start, about that of the end, so that the strip rings little."""

NODES = 1.0 / 32.0
"""Freedoms of nodes over freedoms of atoms: what vibrations of the grid add at equal T."""

WARM = "velocity gimpmd_free create ${kinetic} 4711 dist gaussian mom yes\n"


def warm_case() -> dict[str, Any]:
    """Atoms that start on their sites at twice the temperature: half of it stays kinetic."""
    case = copper_case((16, 2, 2), ((3.3, 12.7), None, None), END)
    case["boundary"] = {}
    case["time"]["md_steps"] = 8
    case["continuum"]["temperature"] = TEMPERATURE
    case["md"]["after"] = "warm.in"
    case["md"]["variables"]["kinetic"] = 2.0 * TEMPERATURE
    stretch = {"gradient": np.diag([START, 0.0, 0.0]).tolist(), "center": [8.0 * H, 0.0, 0.0]}
    case["initial"] = {"stretch": stretch}
    case["output"] = {"interval": 0.16, "energy_interval": 0.16}
    return case


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_warm_strip_of_copper_expands(tmp_path: Path) -> None:
    """The theory is of first order in the temperature; of second order are about 3 %."""
    write_scripts(tmp_path, COPPER)
    (tmp_path / "warm.in").write_text(WARM)
    run = run_in(warm_case(), tmp_path)
    material = run.plan.continuum.material
    assert isinstance(material, Anisotropic)
    assert material.thermal_stress is not None
    expected = -TEMPERATURE * material.thermal_stress[0] / material.stiffness[0][0]
    low, high = run.plan.coupled.interfaces[0].planes[0]

    site, u = mean_displacement(run, run.atoms)
    free = int(((site > low) & (site < high)).sum())
    kinetic = run.energies.md.kinetic[run.energies.time > SETTLED * END].mean()
    temperature = kinetic / (1.5 * free * UNITS["metal"].boltz)
    atoms = slope(site, u, low + H, high - H) / (expected * temperature / TEMPERATURE)
    assert temperature == pytest.approx(TEMPERATURE, rel=0.05)
    assert atoms == pytest.approx(1.0, abs=0.04)

    site, u = mean_displacement(run, run.points)
    sides = [(0.5 * H, low - H), (high + H, 15.5 * H)]
    beside = [(low - H, low), (high, high + H)]
    points, first = (
        np.mean([slope(site, u, *ends) for ends in parts]) / expected for parts in (sides, beside)
    )
    print(f"{temperature:.1f} K, atoms {atoms:.4f}, points {points:.4f}, at planes {first:.4f}")
    assert 0.98 < points < 1.02 + NODES
    assert first == pytest.approx(points, abs=0.05)
    assert abs(sum(energies(run)) - 1.0).max() < 2e-3


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_warm_strip_of_pairs_expands() -> None:
    """In two dimensions, as with the force scheme."""
    for check in expansion("sites"):
        print(check.what, check.measured)
        assert check.passed, check
