"""Sums over the bonds of a crystal with one atom in its primitive cell."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from gimpmd_gimp.laws import Law, thermal_forces
from gimpmd_gimp.laws.law import history_size, is_inelastic
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Crystal
from gimpmd_schemas.errors import BackendError

LONGEST_PERIOD = 20.0
"""Longest period of the rows along a plane, in primitive vectors."""

MODES = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]]])
"""Displacement gradients of unit strain in Voigt's order, with engineering shear."""

STRAIN = 0.01
"""At which a law's stress is compared with the crystal's."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """A crystal bound in pairs, in mechanical units.

    Attributes
    ----------
    vectors : ndarray, shape ``(2, 2)``
        Primitive vectors, one a row (length).
    origin : ndarray, shape ``(2,)``
        One of the sites.
    bonds : ndarray, shape ``(m, 2)``
        Vectors to neighbours, one of each pair of opposite ones.
    energy : ndarray, shape ``(m, degree)``
        ``c_1, c_2, ...`` of the energy ``sum_k c_k (s - 1)^k``, ``s = |r|^2 / |R|^2``.
    """

    vectors: Floats
    origin: Floats
    bonds: Floats
    energy: Floats

    @property
    def area(self) -> float:
        """Area of a site."""
        return float(abs(np.linalg.det(self.vectors)))

    @property
    def reach(self) -> float:
        """Length of the longest bond."""
        return float(np.linalg.norm(self.bonds, axis=1).max())

    def forces(self, F: Floats) -> Floats:
        """Forces ``q = d phi / d r`` in the bonds ``r = F R``, shape ``(m, 2)``."""
        r, square = self.bonds @ F.T, (self.bonds**2).sum(axis=1)
        z = (r**2).sum(axis=1) / square - 1.0
        powers = z[:, None] ** np.arange(self.energy.shape[1])
        slope = (self.energy * np.arange(1, self.energy.shape[1] + 1) * powers).sum(axis=1)
        return (2.0 * slope / square)[:, None] * r

    def stiffnesses(self) -> Floats:
        """``d q / d r`` of the bonds at rest, shape ``(m, 2, 2)``."""
        square = (self.bonds**2).sum(axis=1)[:, None, None]
        first, second = self.energy[:, 0, None, None], 2.0 * self.energy[:, 1, None, None]
        outer = self.bonds[:, :, None] * self.bonds[:, None, :]
        return 2.0 * first / square * np.eye(2) + 4.0 * second / square**2 * outer

    def stress(self, q: Floats) -> Floats:
        """First Piola-Kirchhoff stress, or its change, from the forces in the bonds."""
        return np.einsum("mi,mj->ij", q, self.bonds) / self.area

    def period(self, axis: int) -> float:
        """Shortest translation of the lattice along an axis: the period of rows along a plane.

        Raises
        ------
        BackendError
            No row of sites runs along the axis, or its sites lie too far apart.
        """
        spacing = np.linalg.norm(self.vectors, axis=1).max()
        shortest, tolerance = LONGEST_PERIOD * spacing, 1e-6 * spacing
        # |n|_max <= |T| / (least singular value of the vectors)
        most = int(shortest / np.linalg.svd(self.vectors, compute_uv=False)[-1])
        n = np.arange(-most, most + 1)
        steps = np.stack(np.meshgrid(n, n, indexing="ij"), axis=-1).reshape(-1, 2) @ self.vectors
        along = steps[(np.abs(steps[:, 1 - axis]) < tolerance) & (steps[:, axis] > tolerance), axis]
        if along.size == 0 or along.min() > shortest:
            raise BackendError(
                f"coupling.crystal.vectors = {self.vectors.tolist()}: no row of atoms repeats "
                f"along {'xy'[axis]} within {shortest:g}, so no plane can run that way; turn the "
                "crystal, or use coupling.scheme: velocity"
            )
        return float(along.min())

    def sites(self, low: Floats, high: Floats) -> Floats:
        """Sites in a box, ``low <= X < high``, shape ``(n, 2)``, row by row."""
        corners = np.array(list(product(*zip(low, high, strict=True)))) - self.origin
        index = corners @ np.linalg.inv(self.vectors)
        j = np.arange(np.floor(index[:, 1].min()), np.ceil(index[:, 1].max()) + 1.0)
        start, end = np.full(j.size, index[:, 0].min()), np.full(j.size, index[:, 0].max())
        for axis, step in enumerate(self.vectors[0]):
            if abs(step) > 1e-9 * np.abs(self.vectors[0]).max():
                shift = self.origin[axis] + j * self.vectors[1, axis]
                ends = np.sort([(low[axis] - shift) / step, (high[axis] - shift) / step], axis=0)
                start, end = np.maximum(start, ends[0]), np.minimum(end, ends[1])
        first = np.floor(start)
        count = np.maximum(np.ceil(end) - first + 1.0, 0.0).astype(np.int64)
        row = np.repeat(np.arange(j.size), count)
        i = first[row] + np.arange(row.size) - (np.cumsum(count) - count)[row]
        site = self.origin + np.stack([i, j[row]], axis=1) @ self.vectors
        inside: Floats = site[((site >= low) & (site < high)).all(axis=1)]
        return inside


def make_lattice(crystal: Crystal, factor: float = 1.0, heat: float | None = None) -> Lattice:
    """Lattice of a case's crystal.

    Parameters
    ----------
    crystal : Crystal
    factor : float
        From the energy unit of the style to mass length^2 / time^2.
    heat : float, optional
        Boltzmann's constant times a temperature (mass length^2 / time^2). Bonds then bear the mean
        forces of the crystal's vibrations as well, as its law does; what these have across a bond
        adds to no stress in a hexagonal crystal, and is left out.

    Raises
    ------
    BackendError
        The crystal has no vibrations.
    """
    degree = max(2, *(len(c) for c in crystal.energy))
    energy = np.zeros((len(crystal.energy), degree))
    for row, coefficients in zip(energy, crystal.energy, strict=True):
        row[: len(coefficients)] = coefficients
    energy *= factor
    bonds, vectors = np.array(crystal.bonds), np.array(crystal.vectors)
    if heat is not None:
        forces = thermal_forces(bonds, energy.tolist(), abs(np.linalg.det(vectors)), heat)
        energy[:, 0] += 0.5 * (forces * bonds).sum(axis=1)
    return Lattice(vectors, np.array(crystal.origin), bonds, energy)


def mismatch(lattice: Lattice, law: Law) -> tuple[float, float]:
    """How far a law is from the crystal's own sums.

    Returns
    -------
    moduli : float
        Largest difference of a component of the stiffness at rest, over its largest component.
    stress : float
        The same of the Kirchhoff stress in tension, compression and shear of ``STRAIN``, the
        largest of them.
    """
    step = 1e-4
    F = np.eye(2) + np.concatenate([size * MODES for size in (step, -step, STRAIN, -STRAIN)])
    tau = np.empty_like(F)
    everything, history = (np.arange(len(F)), 0, len(F), F), np.zeros((len(F), history_size(law)))
    if is_inelastic(law):
        law.update(*everything, history)
    law.stress(*everything, history, tau)
    sums = np.array([lattice.stress(lattice.forces(f)) @ f.T for f in F])
    tangent, of_sums = ((t[:3] - t[3:6]) / (2.0 * step) for t in (tau, sums))
    off, size = (np.abs(t[6:]).max(axis=(1, 2)) for t in (tau - sums, sums))
    moduli = np.abs(tangent - of_sums).max() / np.abs(of_sums).max()
    return float(moduli), float((off / size).max())
