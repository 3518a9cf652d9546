"""Two runs of one case side by side, for example coupled against pure MD."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from gimpmd_deploy.results.reading import Particles, Run
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.particle_grid import (
    gimp_stencils,
    grid_to_particles,
    in_cells,
    particles_to_grid,
    window_of,
)

SAME_SITE = 0.2
"""Particles of two runs are the same when their sites differ by less, in their own sizes."""

ROUND_OFF = 1e-9


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Relative L2 differences at one time, ``||a - b|| / ||b||``; null where there is nothing.

    Attributes
    ----------
    displacement_md, stress_md : over the atoms of A deeper than the zones.
    displacement_continuum, stress_continuum : over the material points of A outside the region.
        Stress is the change of sigma_yy since the first output, as the continuum knows no
        stress of surfaces at rest.
    """

    time: float
    displacement_md: float | None
    displacement_continuum: float | None
    stress_md: float | None
    stress_continuum: float | None


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """All shared times, and how well each run kept its energy: largest ``|E - W| / max |W|``."""

    a: str
    b: str
    differences: list[Difference]
    balance_a: float
    balance_b: float


def compare(a: Run, b: Run) -> Comparison:
    """Differences of A from B at every time that both have written.

    Raises
    ------
    InputError
        The runs share no output time.
    """
    near = 0.5 * min(a.case.step(), b.case.step())
    other = np.array(b.times())
    times = [t for t in a.times() if other.size and np.abs(other - t).min() < near]
    if not times:
        message = f"has no output time in common with {b.folder}, which wrote {_list(b.times())}"
        hint = f"{a.folder} wrote {_list(a.times())}; give both the same output.interval"
        raise InputError(str(a.folder), [Problem("output.interval", None, message, hint)])
    return Comparison(
        a=str(a.folder),
        b=str(b.folder),
        differences=[_difference(a, b, time) for time in times],
        balance_a=a.series.balance(),
        balance_b=b.series.balance(),
    )


def _list(times: list[float]) -> str:
    return "at t = " + ", ".join(f"{time:.4g}" for time in times) if times else "nothing"


def _difference(a: Run, b: Run, time: float) -> Difference:
    # the zones of the coupled case part the sides, also where a run has one side alone
    zones = msgspec.structs.replace(a.case, only=None).zones()
    grid = a.case.background_grid()
    atoms, points = _since_start(a.atoms_at, a, time), _since_start(a.points_at, a, time)
    b_atoms, b_points = _since_start(b.atoms_at, b, time), _since_start(b.points_at, b, time)
    md: tuple[float | None, float | None] = (None, None)
    continuum: tuple[float | None, float | None] = (None, None)
    if atoms is not None:
        deep = zones.depth(atoms.site) > zones.innermost
        md = _errors(grid, atoms.where(deep), b_atoms, b_points)
    if points is not None:
        outside = zones.depth(points.site) < 0.0
        continuum = _errors(grid, points.where(outside), b_points, b_atoms)
    return Difference(
        time=time,
        displacement_md=md[0],
        stress_md=md[1],
        displacement_continuum=continuum[0],
        stress_continuum=continuum[1],
    )


def _since_start(
    at: Callable[[float], Particles | None], run: Run, time: float
) -> Particles | None:
    """Particles with the change of their stress since the first output."""
    now, first = at(time), at(run.times()[0])
    if now is None or first is None:
        return None
    return replace(now, stress=now.stress - first.stress)


def _errors(
    grid: BackgroundGrid, mine: Particles, same: Particles | None, other: Particles | None
) -> tuple[float | None, float | None]:
    """Relative errors of displacement and sigma_yy against the other run's particles.

    Parameters
    ----------
    same, other : the other run's particles of the same kind, and of the other kind.
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
    # against nothing but round-off there is no relative error
    return difference / norm if norm > ROUND_OFF * difference else None


def _matched(mine: Particles, theirs: Particles) -> Floats | None:
    """The other run's columns on the same sites; None if it lacks one of them."""
    distance, index = cKDTree(theirs.site).query(mine.site)
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
    inside = (source.site >= corner - grid.cell) & (source.site <= upper + grid.cell)
    source = source.where(np.asarray(inside.all(axis=1)))
    values = np.column_stack([_columns(source), np.ones(len(source.site))])
    sums = np.zeros((grid.size, values.shape[1]))
    particles_to_grid(*_stencils(grid, source), values, sums)
    weight = sums[:, -1:]
    # the last column is one where there is a source
    nodal = np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0.0)
    found = np.empty((len(target.site), values.shape[1]))
    grid_to_particles(*_stencils(grid, target), nodal, found)
    return found[:, :-1], found[:, -1] > 1.0 - 1e-9


def _stencils(grid: BackgroundGrid, particles: Particles) -> tuple[Ints, Floats]:
    # the interpolation function requires half-widths of at most half a cell
    half = np.minimum(0.5 * particles.size / grid.cell, 0.5)
    t = in_cells(grid, particles.site)
    nodes, weights, _ = gimp_stencils(t, half, grid.cell, window_of(grid))
    return nodes, weights
