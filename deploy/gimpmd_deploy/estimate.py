"""What a case will cost: sizes, stability numbers, memory and time, before it runs."""

from __future__ import annotations

import os

import msgspec
import numpy as np

from gimpmd_deploy.prepare import Probe
from gimpmd_schemas.case import Case, Elastic
from gimpmd_schemas.grid import Floats

ATOM_STEPS = 5.0e6
"""Atom steps per second and rank of a short-ranged pair potential."""

POINT_STEPS = 3.0e6
"""Material point steps per second and core."""

BYTES_PER_ATOM, BYTES_PER_POINT, BYTES_PER_NODE = 1000, 400, 200
BYTES_PER_PROCESS = 200 * 2**20
"""Python, its libraries and the bus."""


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """Sizes and cost of a case; null is what only LAMMPS knows (``--probe`` asks it).

    Attributes
    ----------
    cfl : ``c dt / h`` of the continuum step.
    memory : bytes of all processes.
    seconds : wall time.
    """

    atoms: int | None
    points: int
    nodes: int
    steps: int | None
    step: float | None
    md_steps: int | None
    cfl: float | None
    memory: int
    seconds: float | None


def estimate(case: Case, probe: Probe | None) -> Estimate:
    """Size and cost of a case.

    Parameters
    ----------
    case : Case
        Resolved if LAMMPS was asked.
    probe : Probe or None
        LAMMPS's answer, if it was asked.
    """
    known = case.time.md_steps != "auto" or isinstance(case.continuum.material, Elastic)
    points = 0 if case.only == "md" else _count_points(case)
    atoms = 0 if case.only == "continuum" else probe.atoms if probe else None
    nodes = case.background_grid().size
    processes = 1 + sum(case.ranks(role) for role in case.roles())
    memory = (
        processes * BYTES_PER_PROCESS
        + (atoms or 0) * BYTES_PER_ATOM
        + points * BYTES_PER_POINT
        + nodes * BYTES_PER_NODE
    )
    return Estimate(
        atoms=atoms,
        points=points,
        nodes=nodes,
        steps=case.steps() if known else None,
        step=case.step() if known else None,
        md_steps=case.md_steps() if known else None,
        cfl=_cfl(case),
        memory=memory,
        seconds=_seconds(case, atoms, points) if known and atoms is not None else None,
    )


def _count_points(case: Case) -> int:
    """Material points that remain: all but those deeper than the inner zone."""
    edge = case.grid.cell / case.grid.points_per_cell
    axes = [
        low + edge * (np.arange(round((high - low) / edge)) + 0.5) for low, high in case.domain.box
    ]
    x, y = np.meshgrid(*axes, indexing="ij")
    sites: Floats = np.stack([x.ravel(), y.ravel()], axis=1)
    zones = case.zones()
    if case.only is not None:
        return int(sites.shape[0])
    return int((zones.depth(sites) < zones.innermost).sum())


def _cfl(case: Case) -> float | None:
    if case.only == "md" or not isinstance(case.continuum.material, Elastic):
        return None
    return case.wave_speed("P") * case.step() / case.grid.cell


def _seconds(case: Case, atoms: int, points: int) -> float:
    """The sides take turns, so their times add up."""
    cores = os.cpu_count() or 1
    threads = cores if case.continuum.threads == "auto" else case.continuum.threads
    md = case.md_steps() * atoms / (ATOM_STEPS * min(case.md.ranks, cores))
    continuum = points / (POINT_STEPS * min(threads, cores))
    return case.steps() * (md + continuum)
