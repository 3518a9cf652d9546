"""Whether the mesh of a case can be used, before the case runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gimpmd_gimp.fem.body import check_step
from gimpmd_gimp.fem.joining import join_mesh
from gimpmd_gimp.fem.mesh_file import read_mesh
from gimpmd_schemas.case.derive.choices import is_coupled_at_planes
from gimpmd_schemas.case.derive.levels import background_grid, finest_cell
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.grid.planes import Interface


def check_mesh(case: Case, folder: Path) -> None:
    """Check the file that a case names in ``continuum.mesh``, as far as the case is known.

    The mesh must fill the body outside the MD regions, and join the cells of the shared grid. The
    room beyond the planes is checked if they are known, and the time step if the material and the
    planes are.

    Parameters
    ----------
    case : Case
        Checked; with what LAMMPS has measured, if it was asked.
    folder : Path
        The folder of the file.

    Raises
    ------
    BackendError
        The mesh cannot be read, does not fit the body, or is unstable with the time step.
    """
    name = case.continuum.mesh
    if name is None:
        return
    grid = background_grid(case.domain, finest_cell(case))
    plan = make_plan(case) if _is_measured(case) else None
    coupling = plan.coupling if plan else None
    interfaces = coupling.interfaces if coupling else _regions(case)
    absorbs = case.coupling.absorber is not None
    joined = join_mesh(grid, interfaces, read_mesh(folder, name, case.dim), absorbs)
    if plan is not None:
        check_step(plan, plan.continuum.material.density, joined.parts, name)


def _is_measured(case: Case) -> bool:
    """Whether LAMMPS has nothing to measure, or has been asked."""
    material, planes = case.continuum.material, case.coupling.planes
    needs_planes = case.only is None and is_coupled_at_planes(case)
    return not isinstance(material, MeasuredByMd) and not (needs_planes and planes is None)


def _regions(case: Case) -> tuple[Interface, ...]:
    """The MD regions of a coupled case, whose planes are not known."""
    if case.only is not None:
        return ()
    nowhere = ((-np.inf, np.inf),) * case.dim
    return tuple(Interface(nowhere, region) for region in case.atoms.boxes().values())
