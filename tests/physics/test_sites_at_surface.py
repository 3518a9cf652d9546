"""The sites scheme below a free surface, in whole runs with copper by embedded atoms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from tests.copper_sites import COPPER, SPEEDS, H, below_surface, write_scripts
from tests.physics.strips import energies, run_folder
from tests.physics.test_sites_in_space import run_case

pytestmark = pytest.mark.long

STRIP = (12, 2, 8), ((2.3, 9.6), None, (2.3, 8))
"""Cells of a body that is periodic along y, and its atoms below the surface."""

POISSON = 122.6 / 169.9
"""C12 / C11: a strain along an axis of the surface makes the crystal thinner by this much."""


def test_surfaces_at_rest_stay_at_rest(tmp_path: Path) -> None:
    """What is left is the tolerance of the relaxation; without the load it is 1.3e-2."""
    run = run_case(below_surface(*STRIP, 0.64), tmp_path)
    assert np.abs(run.points().fields["strain"]).max() < 1e-6


def test_strain_without_traction_on_the_surface_is_held(tmp_path: Path) -> None:
    """Near the rim the surface, which is of other stiffness than the crystal, changes it a bit."""
    size = 1e-3
    case = below_surface(*STRIP, 1.28)
    case["boundary"] |= {"left": case["boundary"]["back"], "right": case["boundary"]["back"]}
    stretch = {"gradient": np.diag([size, 0.0, -POISSON * size]).tolist()}
    case["initial"] = {"stretch": stretch | {"center": [6.0 * H, 0.0, 0.0]}}
    run = run_case(case, tmp_path)
    exact = np.array([size, 0.0, -POISSON * size, 0.0, 0.0, 0.0])
    assert np.abs(run.points().fields["strain"] - exact).max() < 0.02 * size
    assert abs(sum(energies(run)) - 1.0).max() < 1e-6


PRESS = """\
region near block $(v_xmid-15) $(v_xmid+15) INF INF $(v_top-12) INF units box
group near region near
variable depth equal "step*dt"
variable center equal "v_top + 20 - v_depth"
fix press near indent 10.0 cylinder y ${xmid} v_center 20 units box
variable load equal f_press[3]
fix curve all ave/time 16 1 16 v_depth v_load file load.txt
"""


def test_the_load_of_an_indenter_is_that_of_atoms_alone(tmp_path: Path) -> None:
    """Of a cylinder, pressed into the surface at 100 m / s.

    Depths count from the relaxed surface. In the body of atoms alone it lies higher by .13
    angstrom, because the stress of all its surfaces compresses it.
    """
    case = below_surface((20, 2, 12), ((4.7, 15.4), None, (4.5, 12)), 2.56)
    case["md"] |= {"after": "press.in"}
    case["md"]["variables"] |= {"xmid": 10 * H, "top": 12 * H - 0.25 * COPPER.constant}
    write_scripts(tmp_path)
    (tmp_path / "press.in").write_text(PRESS)
    depth = np.arange(0.4, 2.4, 0.1)
    loads = [load_at(depth, pressed(case, tmp_path, only)) for only in (None, "md")]
    np.testing.assert_allclose(loads[0], loads[1], rtol=0.02)


def pressed(case: dict[str, Any], folder: Path, only: str | None) -> Any:
    """A run of both sides, or of one."""
    place = folder / (only or "both")
    place.mkdir()
    for script in folder.glob("*.in"):
        (place / script.name).write_text(script.read_text())
    dump_case(msgspec.convert(case | {"only": only}, Case), place / "case.yaml")
    return run_folder(place)


def load_at(depth: np.ndarray, run: Any) -> np.ndarray:
    """Load at depths below the surface at rest."""
    first = run.atoms(0)
    top = first.reference[:, 2].max()
    on_top = (first.reference[:, 2] > top - 0.1) & (abs(first.reference[:, 0] - 10 * H) < H)
    rise = (first.position - first.reference)[on_top, 2].mean()
    _, deep, load = np.loadtxt(next(run.folder.rglob("load.txt"))).T
    return np.interp(depth, deep + rise, load)


def test_a_shear_wave_along_the_surface_leaves_the_atoms(tmp_path: Path) -> None:
    """It moves along y, so it is a plane wave between two free surfaces too.

    Kinetic energies count, since stretched surfaces do work against the load on the nodes.
    """
    wavelength, reach, margin = 8.0, 12.0, 8.0
    middle = math.ceil(2 * reach + margin)
    region = ((middle + 0.3, 2 * middle), None, (0, 3))
    case = below_surface((2 * middle, 2, 3), region, 1.0)
    case["boundary"] = {"left": case["boundary"]["back"], "right": case["boundary"]["back"]}
    step = 0.032
    case["time"]["end"] = step * math.ceil((2 * reach + margin) * H / SPEEDS["S"] / step)
    case["output"] = {"interval": case["time"]["end"], "energy_interval": step}
    case["initial"] = {
        "packets": [
            {
                "center": (middle + 0.3 + reach) * H,
                "wavelength": wavelength * H,
                "cycles": 1.0,
                "strain": 2e-4,
                "direction": -1,
                "polarization": "S",
            }
        ]
    }
    found = run_case(case, tmp_path).energies
    reflected, transmitted = (
        2.0 * side.kinetic[-1] / found.energy[0] for side in (found.md, found.continuum)
    )
    assert reflected < 0.01
    assert 0.985 < transmitted < 1.005
