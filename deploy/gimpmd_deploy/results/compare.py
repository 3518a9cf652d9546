"""Two runs of one case compared, for example a coupled run with pure MD."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.particle_grid import (
    gimp_stencils,
    grid_to_particles,
    in_cells,
    particles_to_grid,
    window_of,
)
from gimpmd_schemas.grid.zones import Zones

SAME_SITE = 0.2
"""Particles of two runs are the same if their reference positions differ by less than this
fraction of their size."""

ROUND_OFF = 1e-9
"""A field smaller than this fraction of the difference is zero but for round-off."""


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Relative L2 differences at one time, ``||a - b|| / ||b||``; null where b is zero or absent.

    Attributes
    ----------
    displacement_md, stress_md : over the atoms of A that lie deeper than the zones.
    displacement_continuum, stress_continuum : over the material points of A outside the MD region.
        Stress is the change of sigma_yy since the first output: the continuum has no surface
        stress at rest.
    """

    time: float
    displacement_md: float | None
    displacement_continuum: float | None
    stress_md: float | None
    stress_continuum: float | None


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """Differences at all times that two runs share, and the energy balance of each run.

    Attributes
    ----------
    a, b : run folders.
    balance_a, balance_b : largest absolute imbalance of energy over the scale.
    balance_scale_a, balance_scale_b : name of the scale, ``external work`` or ``initial energy``.
    """

    a: str
    b: str
    differences: list[Difference]
    balance_a: float
    balance_scale_a: str
    balance_b: float
    balance_scale_b: str


def compare(a: Run, b: Run) -> Comparison:
    """Return the differences of A from B at every time that both have written.

    Raises
    ------
    InputError
        The runs share no output time.
    """
    near = 0.5 * min(a.plan.step, b.plan.step)
    other = np.array(b.times)
    times = [t for t in a.times if other.size and np.abs(other - t).min() < near]
    if not times:
        message = f"has no output time in common with {b.folder}, which wrote {_list(b.times)}"
        hint = f"{a.folder} wrote {_list(a.times)}; give both the same output.interval"
        raise InputError(str(a.folder), [Problem("output.interval", None, message, hint)])
    return Comparison(
        a=str(a.folder),
        b=str(b.folder),
        differences=[_difference(a, b, time) for time in times],
        balance_a=a.energies.largest_imbalance(),
        balance_scale_a=a.energies.scale().name,
        balance_b=b.energies.largest_imbalance(),
        balance_scale_b=b.energies.scale().name,
    )


def _list(times: list[float]) -> str:
    return "at t = " + ", ".join(f"{time:.4g}" for time in times) if times else "nothing"


def zones_of(run: Run) -> Zones:
    """Return the zones that separate the sides; in a run of one side those of the coupled case."""
    if run.plan.coupling is not None:
        return run.plan.coupling.zones
    return zones(msgspec.structs.replace(run.case, only=None))


def _difference(a: Run, b: Run, time: float) -> Difference:
    widths, grid = zones_of(a), a.plan.background_grid()
    mine, theirs = _since_start(a, time), _since_start(b, time)
    md: tuple[float | None, float | None] = (None, None)
    continuum: tuple[float | None, float | None] = (None, None)
    atoms, points = mine.get("md"), mine.get("continuum")
    if atoms is not None:
        deep = widths.depth(atoms.reference) > widths.innermost
        md = _errors(grid, atoms.where(deep), theirs.get("md"), theirs.get("continuum"))
    if points is not None:
        outside = widths.depth(points.reference) < 0.0
        continuum = _errors(grid, points.where(outside), theirs.get("continuum"), theirs.get("md"))
    return Difference(
        time=time,
        displacement_md=md[0],
        stress_md=md[1],
        displacement_continuum=continuum[0],
        stress_continuum=continuum[1],
    )


def _since_start(run: Run, time: float) -> dict[Role, Particles]:
    """Particles of each side with the change of their stress since the first output."""
    first = run.particles(run.times[0])
    return {
        role: replace(now, stress=now.stress - first[role].stress)
        for role, now in run.particles(time).items()
        if role in first
    }


def _errors(
    grid: BackgroundGrid, mine: Particles, same: Particles | None, other: Particles | None
) -> tuple[float | None, float | None]:
    """Relative errors of displacement and sigma_yy against the other run's particles.

    Parameters
    ----------
    mine : particles of run A, atoms or points.
    same, other : particles of run B of the same kind, and of the other kind; None if it has none.
    """
    a = _columns(mine)
    b = _matched(mine, same) if same is not None else None
    known = np.ones(len(a), dtype=np.bool_)
    if b is None:
        source = same if same is not None else other
        if source is None:
            return None, None
        b, known = interpolated(grid, source, mine)
    a, b = a[known], b[known]
    return _relative(a[:, :-1], b[:, :-1]), _relative(a[:, -1], b[:, -1])


def _columns(particles: Particles) -> Floats:
    """Components of the displacement, then sigma_yy."""
    return np.column_stack([particles.displacement, particles.stress[:, 1]])


def _relative(a: Floats, b: Floats) -> float | None:
    norm, difference = float(np.linalg.norm(b)), float(np.linalg.norm(a - b))
    # there is no relative error against a field that is zero but for round-off
    return difference / norm if norm > ROUND_OFF * difference else None


def _matched(mine: Particles, theirs: Particles) -> Floats | None:
    """Columns of the other run on the same sites; None if it lacks one of them."""
    distance, index = cKDTree(theirs.reference).query(mine.reference)
    if not (distance < SAME_SITE * mine.size.min(axis=1)).all():
        return None
    return _columns(theirs)[index]


def interpolated(
    grid: BackgroundGrid, source: Particles, target: Particles
) -> tuple[Floats, Bools]:
    """Columns of one run at the sites of another, through the nodes of the background grid.

    Returns
    -------
    columns : ndarray, shape ``(n, d + 1)``
    known : ndarray of bool, shape ``(n,)``
        False where no particle of the source is near.
    """
    corner = np.array(grid.origin)
    upper = corner + grid.cell * np.array(grid.cells)
    inside = (source.reference >= corner - grid.cell) & (source.reference <= upper + grid.cell)
    source = source.where(np.asarray(inside.all(axis=1)))
    values = np.column_stack([_columns(source), np.ones(len(source))])
    nodal = np.zeros((grid.size, values.shape[1]))
    particles_to_grid(*_stencils(grid, source), values, nodal)
    weight = nodal[:, -1:].copy()
    np.divide(nodal, weight, out=nodal, where=weight > 0.0)  # the last column is now 1 or 0
    found = np.zeros((len(target), values.shape[1]))
    grid_to_particles(*_stencils(grid, target), nodal, found)
    return found[:, :-1], found[:, -1] > 1.0 - 1e-9


def _stencils(grid: BackgroundGrid, particles: Particles) -> tuple[Ints, Floats]:
    """Nodes and weights; half-widths are at most half a cell, as the weights need."""
    half = np.minimum(0.5 * particles.size / grid.cell, 0.5)
    x = in_cells(grid, particles.reference)
    nodes, weights, _ = gimp_stencils(x, half, grid.cell, window_of(grid))
    return nodes, weights
