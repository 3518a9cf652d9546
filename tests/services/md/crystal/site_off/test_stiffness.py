"""Second derivatives of the energy of active sites, from those of single sites."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.recognise import Crystal as Lattice
from gimpmd_md.crystal.recognise import CrystalSites, distances, recognise
from gimpmd_md.crystal.site_off.measure import forces
from gimpmd_md.crystal.site_off.stiffness import stiffness
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from tests.services.gimp.coupling.sites.crystals import (
    FCC,
    Bodies,
    Crystal,
    copper,
    lennard_jones,
)
from tests.services.md.crystal.site_off.crystals import SAMPLES, Sample, potential_of

STEP = 1e-4
"""Displacement of atoms (length)."""

Acting = Callable[[np.ndarray, np.ndarray, np.ndarray, Sequence[np.ndarray]], np.ndarray]


def acting(sample: Sample, folder: Path) -> Acting:
    """Forces on a cluster by LAMMPS."""
    potential = with_off_sites(potential_of(sample), 1, folder)

    def found(x, kinds, off, moved):  # type: ignore[no-untyped-def]
        return forces(potential, sample.units, x, kinds, 1, off, moved, MPI.COMM_SELF, folder)

    return found


def sites_in(whole: np.ndarray, x: np.ndarray) -> tuple[Lattice, CrystalSites]:
    """The crystal that fills a larger body, and its sites in a part of it."""
    lattice = recognise(whole, np.ones(len(whole), dtype=int))
    member = distances(lattice.vectors, lattice.origin, lattice.basis, x).argmin(axis=0)
    return lattice, CrystalSites(x, member)


@pytest.mark.parametrize(
    ("make", "name", "cells"),
    [(lennard_jones, "hexagonal LJ", (7, 4)), (copper, "Cu eam/alloy", (4, 2, 1))],
)
def test_it_is_the_derivative_of_the_sums_over_sites(
    make: Callable[[], Crystal], name: str, cells: tuple[int, ...], tmp_path: Path
) -> None:
    """A body with surfaces and edges, in which half of the atoms are active, by formulas."""
    crystal = make()
    x = crystal.sites(tuple((0.0, n * edge) for n, edge in zip(cells, crystal.cell, strict=True)))
    active = x[:, 0] < 0.4 * x[:, 0].max()
    around = tuple((-4.0 * edge, 4.0 * edge) for edge in crystal.cell)
    lattice, sites = sites_in(crystal.sites(around), x)
    free = [None] * crystal.dim
    found = stiffness(lattice, sites, active, crystal.cutoff, free, acting(SAMPLES[name], tmp_path))
    exact = Bodies(crystal, x, active).hessian()
    assert abs(found - exact).max() < 1e-7 * abs(exact).max()


@pytest.mark.parametrize("name", ["Si sw", "Si tersoff"])
def test_it_is_the_derivative_of_forces_on_a_crystal_with_a_basis(
    name: str, tmp_path: Path
) -> None:
    """Along y and z the body is one and two cells long and repeats."""
    a, cutoff = 5.431, {"Si sw": 3.78, "Si tersoff": 3.2}[name]
    n = np.stack(np.meshgrid(*map(np.arange, (5, 1, 2)), indexing="ij"), axis=-1).reshape(-1, 3)
    basis = np.concatenate([FCC, FCC + 0.25]) - 0.125
    x = a * (n[:, None] + basis).reshape(-1, 3)
    active = x[:, 0] > 1.6 * a
    by_lammps = acting(SAMPLES[name], tmp_path)
    images = a * np.array([[0, j, k] for j in (0, -1, 1) for k in (0, -2, 2)])
    every = (images[:, None] + x).reshape(-1, 3)
    lattice, sites = sites_in(every, x)
    body = [None, (0.0, a), (0.0, 2.0 * a)]
    found = stiffness(lattice, sites, active, cutoff, body, by_lammps)
    off = np.concatenate([~active, np.ones(len(every) - len(x), dtype=bool)])
    columns = np.random.default_rng(3).choice(x.size, 12, replace=False)
    units = STEP * np.eye(x.size)[columns].reshape(-1, 1, *x.shape)
    moved = [
        every + (s * np.tile(u, (len(images), 1, 1))).reshape(-1, 3) for u in units for s in (1, -1)
    ]
    on = by_lammps(every, np.ones(len(every), dtype=int), off, moved)
    on = on.reshape(len(moved), len(images), *x.shape).sum(axis=1)  # images count for their atoms
    exact = ((on[1::2] - on[::2]) / (2.0 * STEP)).reshape(len(columns), -1)
    assert abs(found[:, columns].T - exact).max() < 1e-6 * abs(exact).max()
