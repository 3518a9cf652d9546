"""Bodies at rest, and their solvers, in one, two and three dimensions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import Law, LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.groups import ALL, Group
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

UNIT = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
"""Density 1, longitudinal wave speed 1, shear wave speed 1/sqrt(3)."""

SHEAR_SPEED = 3.0**-0.5

Initial = Callable[[MaterialPoints], None]


def body(
    cells: tuple[int, ...],
    method: Method,
    dt: float,
    initial: Initial,
    *,
    cell: float = 1.0,
    periodic: tuple[bool, ...] | None = None,
    finer: tuple[Any, ...] = (),
    law: Law = UNIT,
    per_cell: int = 2,
    comm: Any = None,
    layout: tuple[int, ...] | None = None,
    **conditions: Any,
) -> Solver:
    """Solver of a body that fills its domain; ``dt`` is the step of the coarsest level.

    ``initial`` sets the points' state. Domains are periodic where not said otherwise, and stand
    at the origin.
    """
    d = len(cells)
    hierarchy = Hierarchy((0.0,) * d, cell, cells, periodic or (True,) * d, finer)
    mesh = Mesh(hierarchy, comm, layout)
    points = fill(mesh, per_cell, law.density)
    initial(points)
    return Solver(mesh, points, law, method, dt / 2**hierarchy.top, **conditions)


def step_all(solver: Solver) -> None:
    """One step of the coarsest level."""
    for _ in range(2**solver.top):
        solver.step()


def total_energy(solver: Solver, group: Group = ALL) -> float:
    """Kinetic and strain energy of a group of points."""
    return float(solver.energies(group)[:2].sum())


def largest(values: np.ndarray) -> float:
    """Largest absolute value."""
    return float(np.abs(values).max())
