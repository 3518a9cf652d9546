"""Two runs of one case compared, for example a coupled run with pure MD."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil
from gimpmd_schemas.grid.zones import Zones
from gimpmd_schemas.wire.messages import Role

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
    return msgspec.structs.replace(run.case, only=None).zones()


def _difference(a: Run, b: Run, time: float) -> Difference:
    zones, grid = zones_of(a), a.plan.background_grid()
    mine, theirs = _since_start(a, time), _since_start(b, time)
    md: tuple[float | None, float | None] = (None, None)
    continuum: tuple[float | None, float | None] = (None, None)
    atoms, points = mine.get("md"), mine.get("continuum")
    if atoms is not None:
        deep = zones.depth(atoms.reference) > zones.innermost
        md = _errors(grid, atoms.where(deep), theirs.get("md"), theirs.get("continuum"))
    if points is not None:
        outside = zones.depth(points.reference) < 0.0
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
    columns = _columns(source)
    count = columns.shape[1]
    sums = np.zeros((*grid.shape, count + 1))
    _spread((source.reference - corner) / grid.cell, _halves(source, grid), columns, sums)
    grid.fold(sums)
    weight, sums = sums[..., count:], sums[..., :count]
    nodal = np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0.0)
    reached = np.concatenate([nodal, weight > 0.0], axis=-1)
    values = np.zeros((len(target), count + 1))
    _gather((target.reference - corner) / grid.cell, _halves(target, grid), reached, values)
    return values[:, :count], values[:, count] > 1.0 - 1e-9


def _halves(particles: Particles, grid: BackgroundGrid) -> Floats:
    """Half-widths in cells, at most half a cell as the interpolation function asks."""
    return np.minimum(0.5 * particles.size / grid.cell, 0.5)


@njit(cache=True)
def _spread(x: Floats, half: Floats, values: Floats, sums: Floats) -> None:
    """Add weighted values, and in the last column the weights, to the nodes."""
    for p in range(x.shape[0]):
        i, a0, a1, a2, _, _, _ = stencil(x[p, 0], half[p, 0])
        j, b0, b1, b2, _, _, _ = stencil(x[p, 1], half[p, 1])
        for k, a in enumerate((a0, a1, a2)):
            for m, b in enumerate((b0, b1, b2)):
                node = sums[i + k + PAD, j + m + PAD]
                for c in range(values.shape[1]):
                    node[c] += a * b * values[p, c]
                node[values.shape[1]] += a * b


@njit(cache=True)
def _gather(x: Floats, half: Floats, nodal: Floats, values: Floats) -> None:
    """Interpolate all nodal columns to positions."""
    for p in range(x.shape[0]):
        i, a0, a1, a2, _, _, _ = stencil(x[p, 0], half[p, 0])
        j, b0, b1, b2, _, _, _ = stencil(x[p, 1], half[p, 1])
        for k, a in enumerate((a0, a1, a2)):
            for m, b in enumerate((b0, b1, b2)):
                for c in range(values.shape[1]):
                    values[p, c] += a * b * nodal[i + k + PAD, j + m + PAD, c]
