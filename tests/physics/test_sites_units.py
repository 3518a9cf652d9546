"""The sites scheme in other units than those of metals: a slab in space holds a uniform strain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.copper_sites import COPPER, Metal, copper_case, strained, write_scripts
from tests.physics.strips import run_in
from tests.physics.test_sites_in_space import BODIES, strain_errors

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

STRAIN = 1e-5
STEPS = 160

ENERGY, LENGTH, MASS = 1.65e-21, 3.405e-10, 6.634e-26
"""Argon: J, m, kg."""

ARGON = Metal(
    structure="fcc",
    constant=1.5663247776799987 * LENGTH,
    style=f"lj/smooth/linear {2.2 * LENGTH!r}",
    file=f"{ENERGY!r} {LENGTH!r}",
    element="",
    periods=2.0,
    mass=MASS,
)
"""With the constant at which the derivative of the energy, as a sum over neighbours, is zero."""


def hold(metal: Metal, units: str, md_timestep: float, folder: Path) -> None:
    """Run a slab at a uniform strain, and compare it with the second order of that strain."""
    write_scripts(folder, metal)
    for name in ("crystal.in", "cell.in"):
        script = folder / name
        skin = "neighbor 1e-10 bin\n" if units == "si" else ""
        script.write_text(script.read_text().replace("units metal", f"units {units}") + skin)
    case: dict[str, Any] = strained(copper_case(*BODIES["slab"], 1.0, metal), STRAIN)
    case["units"] = units
    end = STEPS * md_timestep
    case["time"] |= {"end": end, "md_timestep": md_timestep}
    case["output"] = {"interval": end, "energy_interval": 16 * md_timestep}
    run = run_in(case, folder)
    assert strain_errors(run).max() < 30.0 * STRAIN**2
    assert run.energies.largest_imbalance() < metal.noise


def test_copper_in_real_units(tmp_path: Path) -> None:
    """LAMMPS converts the energies of the potential file from eV to kcal/mol."""
    hold(COPPER, "real", 2.0, tmp_path)


def test_argon_in_si_units(tmp_path: Path) -> None:
    hold(ARGON, "si", 8.6e-15, tmp_path)
