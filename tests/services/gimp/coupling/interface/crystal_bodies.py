"""A Lennard-Jones crystal with planes in it, by its lattice sums alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from gimpmd_gimp.coupling.interface.bonds import Bonds, find_bonds
from gimpmd_gimp.coupling.interface.correction import Correction, correct
from gimpmd_gimp.coupling.interface.cutting import cut
from gimpmd_gimp.coupling.interface.lattice import Lattice, make_lattice
from gimpmd_gimp.coupling.interface.terms import Terms, make_terms
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.case.form import Crystal
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil
from gimpmd_schemas.grid.planes import Interface
from tests.physics.lattice import CUTOFF, NEIGHBOURS, SPACING

ROWS = SPACING * 3**0.5 / 2
INF = np.inf

ORIGIN = (0.25 * SPACING, 0.5 * ROWS)
"""Where the crystals of the tests have a site, midway between the first layers."""


def half_star() -> np.ndarray:
    bonds = NEIGHBOURS[np.linalg.norm(NEIGHBOURS, axis=1) < CUTOFF]
    return bonds[(bonds[:, 1] > 1e-9) | ((abs(bonds[:, 1]) < 1e-9) & (bonds[:, 0] > 0))]


def lj_crystal(origin, degree=18) -> Crystal:
    """Energies by their Taylor series in s - 1: exact at rest, to 1e-12 at 5 % strain."""
    energy = []
    for bond in half_star():
        square = bond @ bond
        series = [4.0 * (_minus(6, k) / square**6 - _minus(3, k) / square**3) for k in range(1, 19)]
        energy.append(tuple(series[:degree]))
    return Crystal(
        vectors=((SPACING, 0.0), (0.5 * SPACING, ROWS)),
        origin=tuple(origin),
        bonds=tuple((float(x), float(y)) for x, y in half_star()),
        energy=tuple(energy),
        stretch_limit=0.12,
    )


def sites(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Sites of ``ORIGIN`` in a box, found one row at a time."""
    found = [
        (ORIGIN[0] + (i + 0.5 * (j % 2)) * SPACING, ORIGIN[1] + j * ROWS)
        for j in range(-40, 80)
        for i in range(-40, 80)
    ]
    x = np.array(found)
    return x[((x >= low) & (x <= high)).all(axis=1)]


def _minus(n: int, k: int) -> float:
    """Coefficient of z^k in (1 + z)^-n."""
    return (-1) ** k * comb(n + k - 1, k)


@dataclass(frozen=True)
class Body:
    grid: BackgroundGrid
    interface: Interface
    lattice: Lattice
    points: MaterialPoints
    bonds: Bonds
    correction: Correction
    terms: Terms


def make_body(
    h,
    cells,
    planes,
    origin=ORIGIN,
    periodic=(False, False),
    per_cell=2,
    low=(0.0, 0.0),
    heat=None,
) -> Body:
    """Sites lie at ``origin`` plus lattice vectors; planes infinite where there is none."""
    grid = BackgroundGrid(low, h, cells, periodic)
    size = np.array(cells) * h
    region = tuple(
        (max(p[0] - 2.6, lo), min(p[1] + 2.6, lo + length))
        for p, lo, length in zip(planes, low, size, strict=True)
    )
    interface = Interface(planes=planes, region=region)
    lattice = make_lattice(lj_crystal(origin), heat=heat)
    mesh = Mesh(Hierarchy(low, h, cells, periodic))
    points = cut(fill(mesh, per_cell, 1.0), interface, h)
    bonds = find_bonds(lattice, interface, grid)
    correction = correct(points, lattice, bonds, interface, grid)
    return Body(
        grid,
        interface,
        lattice,
        points,
        bonds,
        correction,
        make_terms(bonds, correction, lattice, grid),
    )


def weights_of(grid: BackgroundGrid, points: MaterialPoints) -> np.ndarray:
    """Weights of points (paper Eq. 14), shape ``(n, grid.size)``, of a domain without period."""
    S = np.zeros((points.count, grid.size))
    for p in range(points.count):
        nodes, weights = [], []
        for axis in range(2):
            t = (points.reference[p, axis] - grid.origin[axis]) / grid.cell
            first, *values = stencil(t, points.half[p, axis])
            nodes.append(first + PAD + np.arange(3))
            weights.append(values[:3])
        S[p, nodes[0][:, None] * grid.shape[1] + nodes[1]] = np.outer(*weights)
    return S
