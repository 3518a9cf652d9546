"""Silicon, with two atoms in its cell: what LAMMPS measures, and atoms that start strained."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.inner_shift import of_plan, shifts
from gimpmd_md.roles import CORE
from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.case.form import Case, Sites
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.resolve import make_plan
from tests.copper_sites import SILICON, copper_case, silicon_slab, strained, write_scripts
from tests.measuring import measured
from tests.services.md.test_stiffness import check_strain, stiffness_of

STRAIN = 1e-5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("silicon")
    write_scripts(path, SILICON)
    return path


def start_of_run() -> dict[str, Any]:
    """A strain, and a rate of strain."""
    case = strained(silicon_slab(), STRAIN)
    rate = {"velocity": [0.0, 0.0, 0.0], "gradient": [[0.2, 0, 0], [0.1, 0, 0], [-0.3, 0, 0]]}
    case["initial"]["velocities"] = [rate]
    return case


@pytest.fixture(scope="module")
def case(folder: Path) -> Case:
    return measured(msgspec.convert(start_of_run(), Case), folder)


@pytest.fixture(scope="module")
def side(case: Case, folder: Path) -> Iterator[MdSide]:
    here = Path.cwd()
    os.chdir(folder)  # scripts are read in the working directory
    try:
        started = open_side(make_plan(case), MPI.COMM_SELF, Path())
    finally:
        os.chdir(here)
    started.finish()
    yield started
    started.close()


def sites_of(case: Case) -> Sites:
    assert case.coupling.sites is not None
    return case.coupling.sites


def test_moduli_and_the_inner_shift_are_the_published_ones(case: Case) -> None:
    """Balamane, Halicioglu and Tiller, Phys. Rev. B 46 (1992): GPa, and Kleinman's parameter."""
    C = 1e-4 * np.array(case.continuum.material.stiffness)
    np.testing.assert_allclose([C[0, 0], C[0, 1], C[3, 3]], [151.4, 76.4, 56.4], rtol=1e-3)
    sites = sites_of(case)
    one, other = np.frombuffer(sites.shift).reshape(2, 6, 3)
    apart = np.zeros((6, 3))
    apart[[3, 4, 5], [0, 1, 2]] = 0.25 * SILICON.constant * 0.63
    np.testing.assert_allclose(np.abs(other - one), apart, rtol=5e-3, atol=1e-12)


def test_ghosts_are_in_balance(case: Case) -> None:
    nodal = np.frombuffer(sites_of(case).force).reshape(7, -1, 3)
    assert np.abs(nodal[1:]).max() > 1e5
    assert np.abs(nodal.sum(axis=1)).max() < 1e-8 * np.abs(nodal).max()


def test_a_strained_crystal_starts_at_rest(case: Case, side: MdSide) -> None:
    """Free atoms have their inner shift; what is left is of second order in the strain."""
    atoms = side.atoms
    free = (atoms.role & CORE) != 0
    on_free, on_all = (np.abs(f).max() for f in (atoms.f[free], atoms.f))
    assert on_free < 50.0 * STRAIN * on_all
    assert free.sum() > 200


def test_nodes_get_the_forces_that_were_measured(case: Case, side: MdSide) -> None:
    """The first-order forces at the strain of the start."""
    sites, plan = sites_of(case), make_plan(case)
    rest, *slopes = np.frombuffer(sites.force).reshape(7, -1, 3)
    gradient = np.array(plan.initial.stretch.gradient)
    expected = rest + sum(
        slope * (gradient[i, j] + (gradient[j, i] if i != j else 0.0))
        for (i, j), slope in zip(VOIGT[3], slopes, strict=True)
    )
    places = np.searchsorted(sites.nodes, side.offers)
    held = np.append(sites.nodes, -1)[places] == side.offers
    found = np.zeros_like(expected)
    found[places[held]] = side.zone_fields()["force"][held]
    np.testing.assert_allclose(found, expected, atol=50.0 * STRAIN * np.abs(expected).max())


def test_ghosts_move_as_the_crystal_does(case: Case, side: MdSide) -> None:
    """At a uniform rate of strain, all atoms have the velocities of one field and their shifts."""
    atoms, rate = side.atoms, np.array(case.initial.velocities[0].gradient)
    everywhere = np.broadcast_to(rate, (len(atoms.site), 3, 3))
    inner = shifts(of_plan(sites_of(case)).at(atoms.site), everywhere)
    assert np.abs(inner).max() > 0.1
    np.testing.assert_allclose(atoms.v, atoms.rest @ rate.T + inner, atol=1e-9)


def test_the_absorber_is_refused(folder: Path) -> None:
    case = silicon_slab()
    case["coupling"]["absorber"] = {}
    with pytest.raises(BackendError, match=r"2 atoms in its primitive cell; coupling\.absorber"):
        measured(msgspec.convert(case, Case), folder)


def test_planes_that_end_at_a_face_are_refused(folder: Path) -> None:
    case = copper_case((10, 2, 8), ((2.3, 7.7), None, (2.2, 8)), 0.16, SILICON)
    case["md"]["minimize"] = True
    with pytest.raises(BackendError, match="front face of the body, and the crystal has 2 atoms"):
        measured(msgspec.convert(case, Case), folder)


def test_its_stiffness_has_inner_shifts(case: Case, folder: Path) -> None:
    """Of displacements that are the same in all periods along y and z."""
    found = stiffness_of(case, folder)
    for m, component in ((0, 0), (4, 2), (5, 1)):
        check_strain(case, found, m, np.outer(np.eye(3)[component], np.eye(3)[0]))
