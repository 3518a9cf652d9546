"""Alloys in the sites scheme: ordered at the planes, random away from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.copper_sites import Metal, copper_case, strained, write_scripts
from tests.physics.strips import run_in
from tests.physics.test_sites_in_space import BODIES, run_case, stir, strain_errors

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

NICKEL = Metal("fcc", 3.52, "eam/alloy", "NiAlH_jea.eam.alloy", "Ni Al", 2.0, types=2)
AXES = "a1 1 0 0 a2 0 1 0 a3 0 0 1 basis 0 0 0"
NI_AL = replace(
    NICKEL,
    structure="custom",
    constant=2.8629893636392016,
    orient=f"{AXES} basis 0.5 0.5 0.5",
    kinds=" basis 2 2",
    periods=3.0,
)
"""The B2 order, two atoms in a primitive cell; its constant has no pressure in LAMMPS."""
NI3_AL = replace(
    NICKEL,
    structure="custom",
    constant=3.5676532284707796,
    orient=f"{AXES} basis 0.5 0.5 0 basis 0.5 0 0.5 basis 0 0.5 0.5",
    kinds=" basis 1 2",
)
"""The L1_2 order, four atoms in a primitive cell."""

SIZE = 1e-5


@pytest.mark.parametrize("body", ["slab", "column"])
@pytest.mark.parametrize("alloy", [NI_AL, NI3_AL], ids=["B2", "L1_2"])
def test_ordered_alloys_hold_uniform_strain(alloy: Metal, body: str, tmp_path: Path) -> None:
    run = run_case(strained(copper_case(*BODIES[body], 0.32, alloy), SIZE), tmp_path, alloy)
    assert strain_errors(run).max() < 30.0 * SIZE**2


def departure(md_steps: int, folder: Path) -> float:
    """How far the energy departs from the start, over the largest work across the planes.

    Deep in a slab of nickel a tenth of the atoms is aluminium, which is larger: it pushes against
    the body, whose nodes are at rest at the start.
    """
    write_scripts(folder, NICKEL)
    script = folder / "crystal.in"
    deep = " ".join(f"{cells * NICKEL.cell!r}" for cells in (6.0, 10.0))
    script.write_text(
        f"{script.read_text()}region deep block {deep} INF INF INF INF units box\n"
        "set region deep type/fraction 2 0.1 12345\n"
    )
    metal = replace(NICKEL, md_steps=md_steps)
    case = stir(copper_case((16, 2, 2), ((2.3, 13.7), None, None), 0.96, metal), metal)
    case["md"]["minimize"] = True
    energies = run_in(case, folder).energies
    work = np.abs(energies.md.interface_work).max()
    return float(np.abs(energies.energy - energies.energy[0]).max() / work)


def test_a_random_alloy_away_from_the_planes_keeps_the_energy(tmp_path: Path) -> None:
    """The error of the energy is that of the coupling step, of second order."""
    coarse, fine = (departure(n, tmp_path / str(n)) for n in (16, 8))
    assert coarse < 0.01
    assert fine < 0.4 * coarse
