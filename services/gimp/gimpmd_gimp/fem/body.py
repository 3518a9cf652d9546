"""The body of finite elements: cells of the shared grid, or a mesh from a file around such cells.

What a mesh leaves open is filled with cells of the shared grid. The coupling scheme needs them
around the atoms: its ghost atoms, and the points that it corrects, belong to nodes of the shared
grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gimpmd_gimp.coupling.interface.cutting import cut
from gimpmd_gimp.fem import face_points
from gimpmd_gimp.fem.elements import Elements, join, make_elements
from gimpmd_gimp.fem.face_points import FacePoints
from gimpmd_gimp.fem.joining import join_mesh
from gimpmd_gimp.fem.mesh_elements import MeshPart
from gimpmd_gimp.fem.mesh_file import read_mesh
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints, take
from gimpmd_gimp.setup import make_hierarchy
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True, eq=False)
class Body:
    """Nodes and elements.

    Attributes
    ----------
    nodes : ndarray, shape ``(nodes, d)``
        Positions at rest.
    row : ndarray of int64, shape ``(ids,)``
        Node of each node of the shared grid; -1 where there is none.
    boxes : MaterialPoints
        They fill the elements of the shared grid, up to the planes.
    elements : Elements
    face_points : callable
        Quadrature points of a face of the domain, from its axis and its side.
    """

    nodes: Floats
    row: Ints
    boxes: MaterialPoints
    elements: Elements
    face_points: Callable[[int, int], FacePoints]


def make_body(plan: Plan, density: float, run_dir: Path) -> Body:
    """Make the body of a plan.

    Raises
    ------
    BackendError
        The mesh cannot be read, does not fit the body, or is unstable with the time step.
    """
    name = plan.continuum.mesh
    if name is None:
        return _on_grid(plan, density)
    return _around(plan, density, run_dir / "input", name)


def _on_grid(plan: Plan, density: float) -> Body:
    """One element for each cell of the shared grid."""
    grid = plan.background_grid()
    boxes = fill(Mesh(make_hierarchy(plan)), plan.continuum.points_per_axis, density)
    boxes = _cut(plan, boxes, grid)

    def points(axis: int, side: int) -> FacePoints:
        return face_points.of_boxes(grid, boxes, axis, side, grid.box[axis][side])

    elements = make_elements(grid, boxes)
    return Body(grid.positions(), np.arange(grid.size), boxes, elements, points)


def _around(plan: Plan, density: float, folder: Path, name: str) -> Body:
    """A mesh from a file around cells of the shared grid."""
    grid = plan.background_grid()
    interfaces = plan.coupling.interfaces if plan.coupling else ()
    absorbs = plan.coupling is not None and plan.coupling.absorber is not None
    joined = join_mesh(grid, interfaces, read_mesh(folder, name, plan.dim), absorbs)
    check_step(plan, density, joined.parts, name)
    parts = [part.elements(grid.cell) for part in joined.parts]
    window, count = joined.window, joined.nodes.shape[0]
    boxes = _fill(plan, window, density)
    index = np.floor((boxes.reference - window.origin) / grid.cell).astype(np.int64)
    boxes = _cut(plan, take(boxes, joined.filled[tuple(index.T)]), grid)
    if boxes.count:
        parts.append(make_elements(window, boxes).renumbered(joined.window_row, count))

    def points(axis: int, side: int) -> FacePoints:
        place = grid.box[axis][side]
        found = [
            part.face_points(axis, place, face_points.ON_FACE * grid.cell) for part in joined.parts
        ]
        of_boxes = face_points.of_boxes(window, boxes, axis, side, place)
        return face_points.join([*found, of_boxes.renumbered(joined.window_row, count)])

    return Body(joined.nodes, joined.row, boxes, join(parts), points)


def _cut(plan: Plan, boxes: MaterialPoints, grid: BackgroundGrid) -> MaterialPoints:
    """The part of the boxes outside the planes."""
    for interface in plan.coupling.interfaces if plan.coupling else ():
        boxes = cut(boxes, interface, grid.cell)
    return boxes


def _fill(plan: Plan, window: BackgroundGrid, density: float) -> MaterialPoints:
    hierarchy = Hierarchy(window.origin, window.cell, window.cells, window.periodic)
    return fill(Mesh(hierarchy), plan.continuum.points_per_axis, density)


def check_step(plan: Plan, density: float, parts: tuple[MeshPart, ...], name: str) -> None:
    """Check the time step against the fastest vibration of each element.

    Raises
    ------
    BackendError
        Leapfrog steps are unstable: they allow ``omega dt <= 2``.
    """
    stiffness = UNITS[plan.units].stress_to_mechanical(1.0) * plan.stiffness()
    fastest = [part.frequencies(stiffness, density) for part in parts]
    omega = np.concatenate(fastest)
    critical = 2.0 / float(omega.max())
    if plan.step <= critical:
        return
    x = np.concatenate([part.centres() for part in parts])[int(omega.argmax())]
    md = plan.md
    key, most = ("time.step", f"{critical:.4g}") if md is None else (
        "time.md_steps", f"{int(critical / md.timestep)} of {md.timestep:g}"
    )  # fmt: skip
    raise BackendError(
        f"{key}: steps of {plan.step:g} are unstable in continuum.mesh = {name!r}, whose element "
        f"at ({', '.join(f'{value:.6g}' for value in x)}) allows at most {critical:.4g}; write at "
        f"most {most}, or make the mesh coarser there"
    )
