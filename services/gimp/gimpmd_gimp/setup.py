"""From a case to a solver: levels, points, law, conditions, initial state."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.conditions import BodyForce, Displaced, Driven, Traction
from gimpmd_gimp.coupling.force import ForceExchange
from gimpmd_gimp.coupling.interface.cutting import cut
from gimpmd_gimp.coupling.scheme import Alone, Exchange
from gimpmd_gimp.coupling.velocity import CORRECTIONS, VelocityExchange
from gimpmd_gimp.fracture.cracks import Cracks, make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy, IndexBox
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import make_law
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints, take
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.solver import Region, Scheme, Solver
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.form import Case, Face
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.grid.planes import interfaces_of
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.initial_state import initial_state
from gimpmd_schemas.mechanics.units import UNITS


def make_solver(case: Case, comm: Any = None) -> Solver:
    """Points, conditions and solver of a case, in its initial state.

    Parameters
    ----------
    case : Case
        With its material resolved.
    comm : mpi4py communicator, optional
        Of as many ranks as ``continuum.ranks``.
    """
    coupled, zones = case.only is None, case.zones()
    hierarchy = make_hierarchy(case)
    # in a coupled run the atoms hold the cracks, deeper than any material point
    cracks = None if coupled else _make_cracks(case, hierarchy)
    layout = None if case.continuum.patches == "auto" else case.continuum.patches
    mesh = Mesh(hierarchy, comm, layout, cracks)

    law = make_law(make_plan(case))
    points = fill(mesh, case.grid.points_per_axis, law.density, history_size(law))
    groups: dict[str, Bools] = {}
    booked: Callable[[Floats], Bools] | None = None
    if coupled and case.coupling.scheme == "force":
        for interface in interfaces_of(case):
            points = cut(points, interface, case.finest_cell())
    elif coupled:
        points = take(points, zones.depth(points.reference) < zones.innermost)
        depth = zones.depth(points.reference)
        groups = {"inner": depth >= zones.handover, "own": depth < zones.energy_plane}
        if case.coupling.scheme == "velocity":
            layer = case.finest_cell() / case.grid.points_per_axis
            groups["rim"] = depth >= zones.innermost - layer

        def booked(x: Floats) -> Bools:
            return zones.depth(x) < zones.energy_plane

    _set_initial_state(case, points)
    return Solver(
        mesh,
        points,
        law,
        make_scheme(case),
        case.step(),
        tractions=make_tractions(case),
        driven=make_driven(case),
        absorbing=make_absorbing(case),
        body_force=make_body_force(case),
        cracks=cracks,
        groups=groups,
        booked=booked,
        threads=thread_count(case.continuum.threads, case.continuum.ranks),
    )


def make_exchange(case: Case, solver: Solver) -> Exchange:
    """The coupling scheme of a case, tied to its solver; collective."""
    if case.only is not None:
        return Alone(solver, case.energies_every())
    if case.coupling.scheme == "force":
        return ForceExchange(case, solver)
    corrections = 0 if case.coupling.scheme == "paper" else CORRECTIONS
    return VelocityExchange(
        solver,
        case.background_grid(),
        case.zones(),
        case.filter_rate(),
        case.energies_every(),
        corrections,
    )


def _make_cracks(case: Case, hierarchy: Hierarchy) -> Cracks | None:
    cracks = case.continuum.cracks
    if not cracks:
        return None
    friction = cracks[0].friction if cracks[0].contact == "frictional" else None
    shapes = [(c.start, c.end) if c.along is None else (c.start, c.end, c.along) for c in cracks]
    return make_cracks(shapes, hierarchy, friction)


def make_hierarchy(case: Case) -> Hierarchy:
    """Levels of a case, boxes on the lattices of their levels."""
    low = tuple(pair[0] for pair in case.domain.box)
    size = [high - lo for lo, high in case.domain.box]
    return Hierarchy(
        low=low,
        cell=case.grid.cell,
        cells=tuple(round(length / case.grid.cell) for length in size),
        periodic=case.domain.periodic,
        finer=tuple(
            tuple(_index_box(box, low, cell) for box in boxes)
            for cell, boxes in zip(case.level_cells()[1:], case.level_boxes()[1:], strict=True)
        ),
    )


def _index_box(box: Box, low: tuple[float, ...], cell: float) -> IndexBox:
    return tuple(
        (round((lo - start) / cell), round((hi - start) / cell))
        for (lo, hi), start in zip(box, low, strict=True)
    )


def make_scheme(case: Case) -> Scheme:
    """How steps are taken."""
    continuum, damping = case.continuum, []
    if continuum.flip < 1.0:
        damping.append(Region(flip=continuum.flip))
    for one in continuum.damping:
        flip = continuum.flip if one.flip is None else one.flip
        damping.append(Region(one.box, one.rate, flip))
    return Scheme(
        integrator=case.integrator(),
        interpolation=continuum.interpolation,
        xpic_order=continuum.xpic.order,
        xpic_every=case.xpic_every(),
        damping=tuple(damping),
        configuration=case.configuration(),
        dispersion=correction(0.5 / case.grid.points_per_axis)
        if case.dispersion() == "corrected"
        else 0.0,
    )


def make_tractions(case: Case) -> list[Traction]:
    """Tractions of the case, in mechanical units."""
    units, tractions = UNITS[case.units], []
    for axis, side, face in _faces(case):
        if face.condition == "traction":
            value = tuple(units.stress_to_mechanical(v or 0.0) for v in face.value)
            tractions.append(Traction(axis, side, value, face.factor))
    return tractions


def make_driven(case: Case) -> list[Driven | Displaced]:
    """Prescribed velocities and displacements of the case."""
    driven: list[Driven | Displaced] = []
    for axis, side, face in _faces(case):
        if face.condition == "symmetry":
            driven.append(Driven(axis, side, axis, lambda _: 0.0))
        if face.condition in ("velocity", "displacement"):
            kind = Driven if face.condition == "velocity" else Displaced
            for component, value in enumerate(face.value):
                if value is not None:
                    driven.append(kind(axis, side, component, _times(value, face)))
    return driven


def make_absorbing(case: Case) -> list[Absorbing]:
    """Faces that let waves out."""
    return [
        Absorbing(axis, side) for axis, side, face in _faces(case) if face.condition == "absorbing"
    ]


def _times(value: float, face: Face) -> Callable[[float], float]:
    return lambda time: value * face.factor(time)


def make_body_force(case: Case) -> BodyForce | None:
    """Body force of the case, uniform in space."""
    force = case.continuum.body_force
    if force is None:
        return None
    acceleration = np.array(force.acceleration)
    return lambda X, time: np.tile(force.factor(time) * acceleration, (X.shape[0], 1))


def thread_count(threads: int | Literal["auto"], ranks: int = 1) -> int:
    """How many threads share a rank's sweeps; ``auto`` shares the cores among the ranks."""
    return max(1, len(os.sched_getaffinity(0)) // ranks) if threads == "auto" else threads


def _set_initial_state(case: Case, points: MaterialPoints) -> None:
    u, v, gradient = initial_state(case, points.reference)
    points.x += u
    points.v += v
    points.F += gradient


def _faces(case: Case) -> list[tuple[int, int, Face]]:
    return [
        (axis, side, case.boundary.face(axis, side))
        for axis in range(case.dim)
        for side in range(2)
    ]
