"""Either side can be replaced: the same wave, with the same bounds, for every pair of codes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.physics.interface import packets
from tests.physics.interface.schemes import SCHEMES
from tests.physics.sides import WAVE, run_sides
from tests.physics.strips import crossing, run_case, run_folder

EXAMPLE = Path(__file__).parents[2] / "examples" / "molybdenum"


@pytest.mark.long
@pytest.mark.parametrize("way", packets.WAYS)
def test_a_wave_crosses_between_ase_and_gimp_as_with_lammps(tmp_path: Path, way: Any) -> None:
    """With the same potential only round-off differs.

    Both runs make the same 245 coupling steps; a difference of one unit in the last place of a
    force grows in proportion to time at most, as all waves are linear.
    """
    grid = run_case(packets.grid(WAVE), tmp_path / "grid", "--only", "continuum")
    runs = {md: run_sides(way, tmp_path / md, md, "gimp") for md in ("lammps", "ase")}
    R, T = crossing(runs["ase"])
    print(f"{way}: R = {R:.5f}, T = {T:.5f}")
    checks = packets.judged("force", WAVE, way, (R, T), crossing(grid))
    assert len(checks) > 2
    assert all(check.passed for check in checks), checks
    energies = {md: run.energies.energy for md, run in runs.items()}
    scale = energies["lammps"].max()
    np.testing.assert_allclose(energies["ase"], energies["lammps"], rtol=0, atol=1e-6 * scale)
    atoms = {md: run.atoms() for md, run in runs.items()}
    order = {md: np.lexsort(a.reference.round(6).T) for md, a in atoms.items()}
    u, w = (atoms[md].displacement[order[md]] for md in ("ase", "lammps"))
    np.testing.assert_allclose(u, w, rtol=0, atol=1e-6 * np.abs(w).max())


@pytest.mark.long
def test_a_wave_enters_a_crystal_with_a_machine_learned_potential(tmp_path: Path) -> None:
    """The example, with the bounds of the velocity scheme for long waves."""
    for file in EXAMPLE.iterdir():
        (tmp_path / file.name).write_text(file.read_text())
    R, T = crossing(run_folder(tmp_path))
    bounds = SCHEMES["velocity"]
    print(f"R = {R:.5f}, T = {T:.5f}")
    assert abs(T - 1.0) < bounds.transmitted_off
    assert bounds.transmitted_off > R
