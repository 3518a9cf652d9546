"""What LAMMPS measures at the planes of the sites scheme."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_schemas.case.derive.levels import background_grid
from gimpmd_schemas.case.form import FACES, Sites
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import H, measured_below_surface, measured_slab
from tests.sites_case import CELL, SCRIPT, measured_case

SURFACE_STRESS = 0.0937
"""Of a relaxed (001) surface of copper, a slab of 40 layers by LAMMPS (eV / angstrom^2)."""


def stress(sites: Sites) -> np.ndarray:
    return np.frombuffer(sites.stress).reshape(4, 2, 2)


def force(sites: Sites) -> np.ndarray:
    return np.frombuffer(sites.force).reshape(4, len(sites.nodes), 2)


def test_stress_is_that_of_the_crystal_and_forces_are_in_balance(tmp_path: Path) -> None:
    sites = measured_case(tmp_path).coupling.sites
    assert sites is not None
    at_rest, *by_strain = stress(sites)
    assert np.abs(at_rest).max() < 1e-8
    moduli = np.array([[P[0, 0], P[1, 1], P[0, 1]] for P in by_strain])
    lame = 27.83316  # Lame's constants are equal
    np.testing.assert_allclose(
        moduli, lame * np.array([[3, 1, 0], [1, 3, 0], [0, 0, 1]]), rtol=1e-4, atol=1e-4
    )
    # the atoms inside are in equilibrium, so forces on all ghosts together vanish
    nodal = force(sites)
    assert np.abs(nodal[1:]).max() > 1.0
    assert np.abs(nodal.sum(axis=1)).max() < 1e-6


@pytest.mark.parametrize(
    ("script", "changes", "said"),
    [
        (
            SCRIPT + "delete_atoms random fraction 0.02 yes all NULL 482793\n",
            {},
            "no atom of type 1 at .*a site",
        ),
        (
            SCRIPT,
            {"md.region": [[2.6 * CELL, 7.9 * CELL], [2.8 * CELL, 12.9 * CELL]]},
            "too narrow",
        ),
        (
            SCRIPT.replace("hex ${density}", "hex ${density} orient x 2 1 0 orient y -1 2 0"),
            {},
            "does not repeat along x",
        ),
        (
            SCRIPT.replace("origin 0.25", "origin 0.1"),
            {"md.region": [[0.0, 9.2 * CELL], [2.8 * CELL, 12.9 * CELL]]},
            "left face of the body, at 0, which lies 0.2 layers",
        ),
    ],
)
def test_what_does_not_suit_is_refused(
    script: str, changes: dict[str, object], said: str, tmp_path: Path
) -> None:
    with pytest.raises(BackendError, match=said):
        measured_case(tmp_path, script, **changes)


@pytest.mark.parametrize("across", [1, pytest.param(2, marks=pytest.mark.long)])
def test_what_is_measured_in_three_dimensions(across: int, tmp_path: Path) -> None:
    """Elastic constants of copper as of a periodic cell, and ghosts in balance.

    The body may be narrower than the surroundings by which a crystal is recognised.
    """
    case = measured_slab(tmp_path, across)
    planes, sites = case.coupling.planes, case.coupling.sites
    assert planes is not None
    assert sites is not None
    assert [face for face in FACES if getattr(planes, face) is not None] == ["left", "right"]
    P = np.frombuffer(sites.stress).reshape(7, 3, 3)
    unit = UNITS["metal"].stress_to_mechanical(1.0)
    C = np.array([[p[i, j] for i, j in VOIGT[3]] for p in P[1:]]) / unit
    np.testing.assert_allclose(C, case.continuum.material.stiffness, rtol=1e-4, atol=10.0)
    assert np.abs(P[0]).max() < 1e-6 * unit * C.max()
    nodal = np.frombuffer(sites.force).reshape(7, len(sites.nodes), 3)
    assert np.abs(nodal.sum(axis=1)).max() < 1e-9 * np.abs(nodal).max()


def test_surfaces_at_a_face_pull_on_its_ghosts(tmp_path: Path) -> None:
    """Free atoms have relaxed, so nothing is left of the forces on all ghosts together."""
    case = measured_below_surface(tmp_path)
    planes, sites = case.coupling.planes, case.coupling.sites
    assert planes is not None
    assert sites is not None
    assert planes.front is None
    surface = np.frombuffer(sites.surface).reshape(-1, 3)
    x = background_grid(case.domain, H).positions()[list(sites.nodes), 0]
    pull = surface[x < 6.0 * H, 0].sum() / (2.0 * H) / UNITS["metal"].force_to_mechanical(1.0)
    assert pull == pytest.approx(SURFACE_STRESS, rel=0.1)  # the ghosts, 27 A apart, do not relax
    assert np.abs(surface.sum(axis=0)).max() < 1.0  # of 1e4
