"""Local temperature of atoms: the energy of their motion relative to their neighbours."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from gimpmd_deploy.results.particles import Particles
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS

WIDTH = 2.0
"""Standard deviation of the Gaussian weight of neighbours, in distances of neighbours."""


def local_temperature(atoms: Particles, units: str) -> Floats:
    """Return the temperature about each atom, shape ``(n,)``.

    With weights w of the atoms in the neighbourhood, which add up to 1, and their mean velocity V
    (weighted with mass too), ``T = sum(w m |v - V|^2) / (d k_B (1 - sum(w^2)))``. The last factor
    accounts for the motion that V takes away, so the mean is right for few neighbours as well. The
    atoms are sorted into cells as large as their distance, and all atoms of a cell get its value.

    Parameters
    ----------
    atoms : Particles
        With the field ``mass``.
    units : str
        Unit style of the case.
    """
    m, v, dim = atoms.fields["mass"], atoms.velocity, atoms.dim
    cells, shape = _cells(atoms)

    def smooth(values: Floats, width: float = WIDTH) -> Floats:
        sums = np.bincount(cells, values, minlength=int(np.prod(shape))).reshape(shape)
        return np.asarray(gaussian_filter(sums, width, mode="constant").ravel()[cells])

    count = smooth(np.ones(len(atoms)))
    mass = smooth(m)
    momentum = [smooth(m * v[:, k]) for k in range(dim)]
    relative = smooth(m * (v**2).sum(axis=1)) - sum(p**2 for p in momentum) / mass
    # the square of a Gaussian weight is a Gaussian weight of a smaller width
    squares = smooth(np.ones(len(atoms)), WIDTH / np.sqrt(2.0)) / (4.0 * np.pi * WIDTH**2) ** (
        0.5 * dim
    )
    freedom = np.maximum(1.0 - squares / count**2, 1e-3)  # of an atom without neighbours: zero
    per_atom = np.maximum(relative, 0.0) / (count * freedom)
    style = UNITS[units]
    return np.asarray(style.energy_from_mechanical(1.0) / (dim * style.boltz) * per_atom)


def _cells(atoms: Particles) -> tuple[np.ndarray, tuple[int, ...]]:
    """Number of the cell of each atom, and the numbers of cells along the axes."""
    edge = float(atoms.size[0, 0])
    places = ((atoms.position - atoms.position.min(axis=0)) / edge).astype(np.int64)
    shape = tuple(int(n) for n in places.max(axis=0) + 1)
    return np.ravel_multi_index(tuple(places.T), shape), shape
