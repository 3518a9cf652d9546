"""Stress of atoms, by the virial or by the strain on the background grid, and largest stresses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_deploy.analysis.sides import counted
from gimpmd_deploy.results.particles import Particles, voigt_names
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_strain.background import GridOptions, total_gradient
from gimpmd_strain.box import Box, Configuration

Route = Literal["virial", "strain"]

CHUNK = 20_000
"""Particles whose surroundings are averaged at a time, which bounds the memory."""


def atomic_stress(run: Run, time: float | None = None, route: Route = "virial") -> Floats:
    """Cauchy stress of the atoms of an output (pressure units), in Voigt order.

    Parameters
    ----------
    time : float, optional
        Default is the last output.
    route : {"virial", "strain"}
        ``virial``: the virial of the forces, over the volume of an atom, as the dump holds it.
        ``strain``: the route of the paper (section 3.3). The displacements of the atoms give a
        strain on the background grid, with the cells of the finest level, and the stiffness of the
        continuum turns it into a stress. Linear weights make it exact for uniform strain at free
        surfaces, too. The strain is taken from the whole displacement instead of increments, so
        that it does not drift.

    Returns
    -------
    ndarray, shape ``(n, 3)`` or ``(n, 6)``
        In the order of ``run.atoms(time)``; NaN for atoms whose strain is undefined.

    Raises
    ------
    ValueError
        The route is unknown.
    """
    atoms = run.atoms(time)
    if route == "virial":
        return atoms.stress
    if route != "strain":
        raise ValueError(f"the route is {route!r}; it must be 'virial' or 'strain'")
    return grid_strain(atoms, run.plan.finest_cell) @ run.plan.stiffness().T


def grid_strain(atoms: Particles, cell: float) -> Floats:
    """Infinitesimal strain of atoms from their displacements on a grid (paper Eqs. 5 to 14).

    Returns
    -------
    ndarray, shape ``(n, 3)`` or ``(n, 6)``
        In Voigt order with engineering shear; NaN for atoms with too few neighbours.
    """
    d, rest = atoms.dim, atoms.reference
    box = Box(rest.min(axis=0), np.diag(np.ptp(rest, axis=0) + cell), np.zeros(d, dtype=bool))
    options = GridOptions(cell=cell, spacing=min(float(atoms.size[0, 0]), cell))
    before, now = Configuration(box, rest), Configuration(box, rest + atoms.displacement)
    H = total_gradient(before, now, np.ones(len(atoms)), options, None)
    shear = [H[:, i, j] + H[:, j, i] for i, j in VOIGT[d][d:]]
    return np.stack([*(H[:, k, k] for k in range(d)), *shear], axis=1)


def average(particles: Particles, values: Floats, radius: float, at: Bools | None = None) -> Floats:
    """Average values over the particles within a radius, weighted by their volumes.

    Parameters
    ----------
    values : ndarray, shape ``(n,)``
        NaN are left out.
    at : ndarray of bool, shape ``(n,)``, optional
        The particles around which averages are taken; default is all.

    Returns
    -------
    ndarray
        One value for each particle of ``at``; NaN where there is nothing to average.
    """
    x, volume = particles.position, particles.size.prod(axis=1)
    tree = cKDTree(x)
    centres = x if at is None else x[at]
    known = np.isfinite(values)
    weight, product = np.where(known, volume, 0.0), np.where(known, volume * values, 0.0)
    parts = []
    for start in range(0, len(centres), CHUNK):
        near = tree.query_ball_point(centres[start : start + CHUNK], radius)
        first = np.cumsum([0, *(len(one) for one in near[:-1])])
        index = np.concatenate(near).astype(np.int64)
        total = np.add.reduceat(weight[index], first)
        parts.append(np.add.reduceat(product[index], first) / np.where(total > 0.0, total, np.nan))
    return np.concatenate(parts) if parts else np.empty(0)


@dataclass(frozen=True)
class MaximumStress:
    """The largest stress at one time.

    Attributes
    ----------
    value : float
        Pressure units.
    position : ndarray, shape ``(d,)``
        Where it is, now.
    side : {"md", "continuum"}
        Which side carries it.
    """

    value: float
    position: Floats
    side: Role


def maximum_stress(
    run: Run,
    component: str,
    time: float | None = None,
    *,
    radius: float,
    route: Route = "virial",
    region: tuple[tuple[float, float], ...] | None = None,
) -> MaximumStress:
    """Find the largest stress of a run at an output, averaged over a radius.

    The stress of a single atom or point at a crack tip depends on its size. The mean over a radius
    can be compared between runs that resolve the tip by atoms and by points.

    Parameters
    ----------
    component : str
        ``xx``, ``yy``, ``xy`` and so on.
    time : float, optional
        Default is the last output.
    radius : float
        Of the circle or sphere over which the stress around each atom and each point is averaged.
    route : {"virial", "strain"}
        Of the stress of atoms, see `atomic_stress`.
    region : tuple of (float, float), optional
        Limits of the present positions along each axis; default is the whole body.

    Returns
    -------
    MaximumStress

    Raises
    ------
    InputError
        There is no such component, or there are no particles in the region.
    """
    names = voigt_names(run.plan.dim)
    if component not in names:
        hint = "choose one of " + ", ".join(names)
        problem = Problem("component", component, "is no component of the stress", hint)
        raise InputError(str(run.folder), [problem])
    column = names.index(component)
    found = []
    for role in run.plan.roles:
        particles = run.atoms(time) if role == "md" else run.points(time)
        stress = atomic_stress(run, time, route) if role == "md" else particles.stress
        own = counted(run.plan, role, particles.reference)
        body, values = particles.where(own), stress[own, column]
        inside = _inside(body.position, region)
        means = average(body, values, radius, inside)
        if np.isfinite(means).any():
            best = int(np.nanargmax(means))
            found.append(MaximumStress(float(means[best]), body.position[inside][best], role))
    if not found:
        problem = Problem("region", region, "holds no atoms and no material points", "enlarge it")
        raise InputError(str(run.folder), [problem])
    return max(found, key=lambda one: one.value)


def _inside(x: Floats, region: tuple[tuple[float, float], ...] | None) -> Bools:
    inside = np.ones(len(x), dtype=bool)
    for axis, (low, high) in enumerate(region or ()):
        inside &= (x[:, axis] >= low) & (x[:, axis] <= high)
    return inside
