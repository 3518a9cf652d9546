"""Made-up atoms and material points."""

from __future__ import annotations

import numpy as np

from gimpmd_deploy.results.particles import Particles

SPACING = 1.1132


def hexagonal(box, a=SPACING):
    """Sites of a hexagonal lattice in ``(x0, x1), (y0, y1)``.

    Rows lie along x, and y = 0 is midway between two of them.
    """
    (x0, x1), (y0, y1) = box
    row = a * 3**0.5 / 2
    j = np.arange(np.ceil(y0 / row - 0.5), np.floor(y1 / row - 0.5) + 1)
    sites = []
    for k in j:
        shift = 0.5 * a * (k % 2)
        x = a * np.arange(np.ceil((x0 - shift) / a), np.floor((x1 - shift) / a) + 1) + shift
        sites.append(np.stack([x, np.full(x.size, (k + 0.5) * row)], axis=1))
    return np.concatenate(sites)


def turned(x, angle):
    """Rotate vectors ``(n, 2)`` by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, s], [-s, c]])


def particles(sites, u=None, v=None, stress=None, time=0.0, size=SPACING, **fields):
    """Atoms or points at reference positions ``sites`` with these displacements and velocities."""
    zero = np.zeros_like(sites)
    u, v = zero if u is None else u, zero if v is None else v
    d = sites.shape[1]
    return Particles(
        time=time,
        reference=sites,
        position=sites + u,
        displacement=u,
        velocity=v,
        stress=np.zeros((len(sites), 3 if d == 2 else 6)) if stress is None else stress,
        size=np.full(sites.shape, size),
        fields=fields,
    )


class MadeUpRun:
    """Stands for a run: its outputs are functions of time."""

    def __init__(self, times, atoms):
        self.times, self.atoms = list(times), atoms
