"""From a plan to a solver: levels, points, law, conditions, initial state."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.condition import Condition
from gimpmd_gimp.boundary.prescribed import Prescribed
from gimpmd_gimp.coupling.interface.cutting import SECOND_PIECE, cut, divide
from gimpmd_gimp.coupling.sites.layout import Layout, slaves_of
from gimpmd_gimp.fracture.cracks import Cracks, make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy, IndexBox
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import make_law
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints, join, take
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.registry import collect


def make_solver(plan: Plan, comm: Any = None, layout: Layout | None = None) -> Solver:
    """Points, conditions and solver of a plan, in its initial state.

    Parameters
    ----------
    plan : Plan
    comm : mpi4py communicator, optional
        With ``plan.continuum.ranks`` ranks.
    layout : Layout, optional
        Of the interface, in the sites scheme.
    """
    hierarchy, per_axis = make_hierarchy(plan), plan.continuum.points_per_axis
    # in a coupled run the atoms hold the cracks, deeper than any material point
    cracks = None if plan.coupling else _make_cracks(plan, hierarchy)
    slaves = None if layout is None else slaves_of(layout)
    mesh = Mesh(hierarchy, comm, plan.continuum.patches, cracks, slaves)
    law = make_law(plan)
    points = fill(mesh, per_axis, law.density, history_size(law))

    inner: Bools | None = None
    rim: Bools | None = None
    counted: Callable[[Floats], Bools] | None = None
    if plan.coupling is not None and plan.coupling.scheme in AT_PLANES:
        for interface in plan.coupling.interfaces:
            points = cut(points, interface, plan.finest_cell)
            if interface.second is not None:
                points = _without_stress(points, interface.second, plan.finest_cell)
    elif plan.coupling is not None:
        zones = plan.coupling.zones
        points = take(points, zones.depth(points.reference) < zones.innermost)
        depth = zones.depth(points.reference)
        inner = depth >= zones.handover
        if plan.coupling.scheme == "velocity":
            rim = depth >= zones.innermost - plan.finest_cell / per_axis

        def counted(x: Floats) -> Bools:
            return zones.depth(x) < zones.energy_plane

    _set_initial_state(plan, points)
    return Solver(
        mesh,
        points,
        law,
        make_method(plan),
        plan.step,
        conditions=make_conditions(plan),
        cracks=cracks,
        inner=inner,
        rim=rim,
        counted=counted,
        threads=thread_count(plan.continuum.threads, plan.continuum.ranks),
    )


def _without_stress(points: MaterialPoints, second: Box, cell: float) -> MaterialPoints:
    """Points up to the second planes keep their mass, but have no volume, and so no stress."""
    outside, between = divide(points, second, cell, SECOND_PIECE)
    between.volume[:] = 0.0
    return join([outside, between])


def _make_cracks(plan: Plan, hierarchy: Hierarchy) -> Cracks | None:
    cracks = plan.continuum.cracks
    if not cracks:
        return None
    friction = cracks[0].friction if cracks[0].contact == "frictional" else None
    shapes = [(c.start, c.end) if c.along is None else (c.start, c.end, c.along) for c in cracks]
    return make_cracks(shapes, hierarchy, friction)


def make_hierarchy(plan: Plan) -> Hierarchy:
    """Levels of a plan, with boxes on the lattices of their levels."""
    low, cell = tuple(pair[0] for pair in plan.domain.box), plan.level_cells[0]
    size = [high - lo for lo, high in plan.domain.box]
    return Hierarchy(
        low=low,
        cell=cell,
        cells=tuple(round(length / cell) for length in size),
        periodic=plan.domain.periodic,
        finer=tuple(
            tuple(_index_box(box, low, edge) for box in boxes)
            for edge, boxes in zip(plan.level_cells[1:], plan.level_boxes[1:], strict=True)
        ),
    )


def _index_box(box: Box, low: tuple[float, ...], cell: float) -> IndexBox:
    return tuple(
        (round((lo - start) / cell), round((hi - start) / cell))
        for (lo, hi), start in zip(box, low, strict=True)
    )


def make_method(plan: Plan) -> Method:
    """How steps are taken."""
    continuum, damping = plan.continuum, []
    if continuum.flip < 1.0:
        damping.append(DampingRegion(flip=continuum.flip))
    for one in continuum.damping:
        flip = continuum.flip if one.flip is None else one.flip
        damping.append(DampingRegion(one.box, one.rate, flip))
    corrected = continuum.dispersion == "corrected"
    return Method(
        integrator=continuum.integrator,
        interpolation=continuum.interpolation,
        xpic_order=continuum.xpic_order,
        xpic_every=continuum.xpic_every,
        damping=tuple(damping),
        configuration=continuum.configuration,
        dispersion=correction(0.5 / continuum.points_per_axis) if corrected else 0.0,
    )


def make_conditions(plan: Plan) -> list[Condition]:
    """Conditions of the plan in the order in which they act: loads, then prescribed values."""
    makers = collect("gimpmd_gimp.boundary", "FACE_CONDITIONS")
    units, conditions = UNITS[plan.units], list[Condition]()
    for part in plan.face_parts():
        conditions += makers[part.condition.condition](part, units)
    force = plan.continuum.body_force
    if force is not None:
        acceleration = np.array(force.acceleration)
        conditions.append(
            BodyForce(lambda X, time: np.tile(force.factor(time) * acceleration, (X.shape[0], 1)))
        )
    return sorted(conditions, key=lambda condition: isinstance(condition, Prescribed))


def thread_count(threads: int | Literal["auto"], ranks: int = 1) -> int:
    """How many threads share a rank's sweeps; ``auto`` shares the cores among the ranks."""
    return max(1, len(os.sched_getaffinity(0)) // ranks) if threads == "auto" else threads


def _set_initial_state(plan: Plan, points: MaterialPoints) -> None:
    u, v, gradient = initial_state(plan, points.reference)
    points.x += u
    points.v += v
    points.F += gradient
