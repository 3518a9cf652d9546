"""Cost of a case before it runs: sizes, stability numbers, memory and time."""

from __future__ import annotations

import os
from math import prod

import msgspec
import numpy as np

from gimpmd_deploy.launch.modes import Modes
from gimpmd_schemas.case.derive import levels as grid_levels
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.grid.zones import Box, MdRegion
from gimpmd_schemas.wire.answers import CorrectionSize, Probe

ATOM_STEPS = 5.0e6
"""Atom steps per second and rank of a short-ranged pair potential."""

POINT_STEPS = 1.0e7
"""Material-point steps per second and core."""

BYTES_PER_ATOM, BYTES_PER_POINT, BYTES_PER_NODE = 1000, 730, 250
BYTES_PER_PROCESS = 200 * 2**20
"""Python, its libraries and the bus."""


class LevelSize(msgspec.Struct, frozen=True, kw_only=True):
    """Size of one level of the grid.

    Attributes
    ----------
    cell : edge of its cells.
    cells : in its boxes, including those that a finer level covers.
    nodes : in its boxes.
    points : material points on it.
    step : its time step; null if only LAMMPS knows it.
    """

    cell: float
    cells: int
    nodes: int
    points: int
    step: float | None


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """Sizes and cost of a case; null where only LAMMPS knows the answer (``--probe`` asks it).

    Attributes
    ----------
    levels : levels of the continuum's grid, the coarsest first.
    points, nodes : sums over the levels.
    steps, step : number and size of the coupling steps, which are those of the finest level.
    md_steps : MD steps in a coupling step; null also in a case without atoms.
    cfl : ``c dt / h`` of the continuum, the same on every level.
    correction : what the correction of the sites scheme takes in each rank of the continuum; null
        also without that scheme.
    modes : of atoms and nodes in the sites scheme; null also without it.
    memory : of all processes (bytes).
    seconds : wall time on this machine.
    """

    atoms: int | None
    levels: list[LevelSize]
    points: int
    nodes: int
    steps: int | None
    step: float | None
    md_steps: int | None
    cfl: float | None
    correction: CorrectionSize | None
    modes: Modes | None
    memory: int
    seconds: float | None


def estimate(
    case: Case,
    probe: Probe | None,
    correction: CorrectionSize | None = None,
    modes: Modes | None = None,
) -> Estimate:
    """Size and cost of a case.

    Parameters
    ----------
    case : Case
        With what LAMMPS measured, if it was asked.
    probe : Probe or None
        LAMMPS's answer, if it was asked.
    correction : CorrectionSize or None
        The continuum's answer, if there is a correction.
    modes : Modes or None
        See `look_at_modes`.
    """
    measured = not isinstance(case.continuum.material, MeasuredByMd)
    given = case.time.step if case.md is None else case.time.md_steps
    known = measured or given != "auto"
    atoms = 0 if case.only == "continuum" else probe.atoms if probe else None
    levels = [] if case.only == "md" else _levels(case, times.step(case) if known else None)
    points, nodes = sum(level.points for level in levels), sum(level.nodes for level in levels)
    processes = 1 + sum(case.ranks(role) for role in case.roles())
    memory = (
        processes * BYTES_PER_PROCESS
        + (atoms or 0) * BYTES_PER_ATOM
        + points * BYTES_PER_POINT
        + nodes * BYTES_PER_NODE
        + (case.continuum.ranks * correction.memory if correction else 0)
    )
    return Estimate(
        atoms=atoms,
        levels=levels,
        points=points,
        nodes=nodes,
        steps=times.steps(case) if known else None,
        step=times.step(case) if known else None,
        md_steps=times.md_steps(case) if known and case.md is not None else None,
        cfl=_cfl(case) if measured else None,
        correction=correction,
        modes=modes,
        memory=memory,
        seconds=_seconds(case, atoms, levels) if known and atoms is not None else None,
    )


def _levels(case: Case, step: float | None) -> list[LevelSize]:
    """Sizes of all levels; a point belongs to the finest level that covers it."""
    cells, boxes = grid_levels.cells(case), grid_levels.boxes(case)
    finest = len(cells) - 1
    covered = [sum(map(_volume, level)) for level in (*boxes[1:], ())]
    sizes = []
    for k, h in enumerate(cells):
        in_boxes = [_counts(box, h) for box in boxes[k]]
        own = round((sum(map(_volume, boxes[k])) - covered[k]) / h**case.dim)
        sizes.append(
            LevelSize(
                cell=h,
                cells=sum(map(prod, in_boxes)),
                nodes=sum(prod(n + 1 for n in counts) for counts in in_boxes),
                points=own * case.grid.points_per_axis**case.dim
                - (_dropped(case) if k == finest else 0),
                step=None if step is None else step * 2 ** (finest - k),
            )
        )
    return sizes


def _volume(box: Box) -> float:
    return prod(high - low for low, high in box)


def _counts(box: Box, h: float) -> list[int]:
    return [round((high - low) / h) for low, high in box]


def _dropped(case: Case) -> int:
    """Sites without points: those deeper than the inner zone of a coupled run."""
    if case.only is not None:
        return 0
    zones = zones_of(case)
    return sum(_within(case, region, zones.innermost) for region in zones.regions)


def _within(case: Case, region: MdRegion, depth: float) -> int:
    """Number of sites of points that lie deeper in a region than ``depth``."""
    edge, counts = grid_levels.finest_cell(case) / case.grid.points_per_axis, []
    for axis, ((low, high), sides) in enumerate(zip(region.box, region.interfaces, strict=True)):
        origin, end = case.domain.box[axis]
        sites = origin + edge * (np.arange(round((end - origin) / edge)) + 0.5)
        deep = np.ones(sites.size, dtype=np.bool_)
        if sides[0]:
            deep &= sites - low >= depth
        if sides[1]:
            deep &= high - sites >= depth
        counts.append(int(deep.sum()))
    return prod(counts)


def _cfl(case: Case) -> float | None:
    if case.only == "md":
        return None
    return wave_speed(case, "P") * times.step(case) / grid_levels.finest_cell(case)


def _seconds(case: Case, atoms: int, levels: list[LevelSize]) -> float:
    """Wall time: the sides take turns, so their times add up; coarse levels step less often."""
    cores = os.cpu_count() or 1
    threads = cores if case.continuum.threads == "auto" else case.continuum.threads
    workers = min(case.continuum.ranks * threads, cores)
    per_step = sum(level.points / 2 ** (len(levels) - 1 - k) for k, level in enumerate(levels)) / (
        POINT_STEPS * workers
    )
    if atoms:
        per_step += times.md_steps(case) * atoms / (ATOM_STEPS * min(case.atoms.ranks, cores))
    return times.steps(case) * per_step
