"""The energy of crystals in space that LAMMPS measures, against its stress at other strains."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_gimp.laws import AnisotropicElastic, CauchyBorn, Law
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.probe import measure
from gimpmd_schemas.case.materials import Hyperelastic, MeasuredByMd, stiffness
from tests.copper_sites import (
    ALUMINIUM,
    COPPER,
    COPPER_110,
    COPPER_111,
    IRON,
    MAGNESIUM,
    SILICON,
    TUNGSTEN,
    Metal,
    write_scripts,
)
from tests.services.gimp.laws.sample_laws import stress

SIZES = (0.005, 0.01, 0.02, 0.03, 0.05)
"""Norms of the strains."""

COUNT = 40
"""Random strains of each size."""


@dataclass(frozen=True)
class Laws:
    """The linear law of a crystal, and the one that follows it at finite strains."""

    linear: Law
    finite: Law


def laws_of(metal: Metal, folder: Path, degree: int | None = None) -> Laws:
    """Laws of a crystal by LAMMPS, in its units of pressure."""
    write_scripts(folder, metal)
    asked = MeasuredByMd(cell=str(folder / "cell.in"), model="cauchy-born", degree=degree)
    found = measure(asked, "metal", 3, MPI.COMM_SELF, folder / "log.lammps")
    assert isinstance(found, Hyperelastic)
    return Laws(
        AnisotropicElastic(1.0, stiffness(found, 3)),
        CauchyBorn(1.0, np.array(found.coefficients), found.strain_limit, 3),
    )


def gradients(size: float) -> np.ndarray:
    """Upper triangular deformation gradients of random strains of this size."""
    A = np.random.default_rng(round(1e4 * size)).standard_normal((COUNT, 3, 3))
    E = A + A.transpose(0, 2, 1)
    E *= size / np.linalg.norm(E, axis=(1, 2))[:, None, None]
    return np.asarray(np.linalg.cholesky(np.eye(3) + 2.0 * E).transpose(0, 2, 1)).copy()


def errors(law: Law, cell: Cell, size: float) -> np.ndarray:
    """Errors of the second Piola-Kirchhoff stress, over the largest stress at this size."""
    F = gradients(size)
    rest, back = cell.deform(np.eye(3))[1], np.linalg.inv(F)
    exact = np.array([b @ cell.deform(f)[1] @ b.T - rest for f, b in zip(F, back, strict=True)])
    if law.finite:
        found = back @ stress(law, F) @ back.transpose(0, 2, 1)
    else:  # its strain is E here, as in the table that it is compared with
        found = stress(law, np.eye(3) + 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3)))
    missing = np.linalg.norm(found - exact, axis=(1, 2))
    return np.asarray(missing / np.linalg.norm(exact, axis=(1, 2)).max())


def table(metal: Metal, folder: Path, degree: int | None = None) -> dict[str, np.ndarray]:
    """Medians and largest errors of both laws at each size of the strain, ``(sizes, 2)``."""
    laws = laws_of(metal, folder, degree)
    log = folder / "log.lammps"
    with open_cell(str(folder / "cell.in"), "metal", MPI.COMM_SELF, log, dims=(3,)) as cell:
        found = {
            name: [errors(law, cell, size) for size in SIZES]
            for name, law in (("linear", laws.linear), ("finite", laws.finite))
        }
    return {name: np.array([(np.median(e), e.max()) for e in rows]) for name, rows in found.items()}


def test_stress_of_copper(tmp_path: Path) -> None:
    """Medians no worse than those of an independent fit with free moduli.

    That one left 6e-4, 7e-4, 1e-3, 5e-3 and 2e-2.
    """
    found = table(COPPER, tmp_path)
    assert (found["finite"][:, 0] < [6e-4, 1e-3, 2e-3, 5e-3, 3e-2]).all()
    assert (found["finite"][:4, 1] < 0.01).all()
    assert (found["linear"][:4] > 5.0 * found["finite"][:4]).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("metal", "most"),
    [
        (COPPER_110, 0.01),
        (COPPER_111, 0.01),
        (ALUMINIUM, 0.005),
        (IRON, 0.02),
        (TUNGSTEN, 0.002),
        (SILICON, 2e-4),
        (MAGNESIUM, 0.06),
    ],
)
def test_stress_of_other_crystals(metal: Metal, most: float, tmp_path: Path) -> None:
    """Other orientations, and hexagonal close packing: fewer terms vanish.

    Silicon and magnesium have atoms that shift within the primitive cell.
    """
    found = table(metal, tmp_path)
    assert (found["finite"][:4, 1] < most).all()
    assert (found["finite"][:4] < found["linear"][:4]).all()


@pytest.mark.long
def test_a_higher_degree_is_more_accurate(tmp_path: Path) -> None:
    """Where the potential is smooth; silicon up to 2 %."""
    worst = [table(SILICON, tmp_path / str(d), d)["finite"][:3, 1].max() for d in (3, 4, 5)]
    assert worst[0] > 10.0 * worst[1] > 50.0 * worst[2]
