"""Stiffness of the atoms of the sites scheme: of free atoms, and of the nodes that move ghosts.

Atoms near the planes are a perfect crystal, and here all atoms are that crystal at rest: defects
inside a region have modes of their own, which say nothing about the planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from gimpmd_md.coupling.shape_functions import ShapeFunctions
from gimpmd_md.crystal import find_sites
from gimpmd_md.crystal.inner_shift import InnerShift, of_plan
from gimpmd_md.crystal.recognise import SAME
from gimpmd_md.crystal.site_off.measure import forces
from gimpmd_md.crystal.site_off.stiffness import stiffness
from gimpmd_md.engines.lammps.script import Script, build, cutoff_of
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.answers import FreeAtoms
from gimpmd_schemas.wire.stiffness import MOST, Stiffness


def measure(case: Case, comm: Any, folder: Path, out: Path) -> FreeAtoms:
    """Write the stiffness of the atoms of a case, if they are few enough; see `Stiffness`.

    Parameters
    ----------
    case : Case
        With what LAMMPS has measured at the planes. Its script is in the working directory.
    comm : mpi4py communicator
        Of one rank.
    folder : Path
        For the files of LAMMPS.
    out : Path
        The file.

    Raises
    ------
    BackendError
        LAMMPS refuses the script.
    """
    script = Script.of_case(case)
    engine = build(script, comm, folder / "log.lammps")
    atoms = find_sites.atoms_of(script.path, engine, cutoff_of(script, engine), folder)
    engine.close()
    plan, crystal = make_plan(case), find_sites.crystal_near(case, atoms, zones(case).regions[0])
    slack = SAME * float(np.linalg.norm(crystal.vectors[0]))

    def acting(x: Floats, kinds: Any, off: Any, moved: Any) -> Floats:
        potential, types = atoms.off.potential, atoms.off.types
        return forces(potential, case.units, x, kinds, types, off, moved, comm, folder)

    body = tuple(
        ends if periodic else None
        for ends, periodic in zip(case.domain.box, case.domain.periodic, strict=True)
    )
    regions = []
    for interface in plan.coupled.interfaces:
        sites = find_sites.sites_of(case, crystal, interface, atoms.cutoff, slack)
        regions.append((interface, sites.take(find_sites.in_body(case, sites.x, slack))))
    freedoms = case.dim * sum(int((on.depth(sites.x) > 0.0).sum()) for on, sites in regions)
    if freedoms <= MOST[case.dim]:
        parts = [
            (
                interface,
                sites.x,
                stiffness(crystal, sites, ~interface.off(sites.x), atoms.cutoff, body, acting),
            )
            for interface, sites in regions
        ]
        measured, unit = plan.coupled.sites, UNITS[case.units].force_to_mechanical(1.0)
        shift = None if measured is None else of_plan(measured)
        _of_freedoms(plan.background_grid(), shift, parts, unit).save(out)
    return FreeAtoms(freedoms=freedoms)


def _of_freedoms(
    grid: BackgroundGrid,
    shift: InnerShift | None,
    parts: Sequence[tuple[Interface, Floats, sparse.csr_array]],
    unit: float,
) -> Stiffness:
    """Let ghosts move with the nodes, and sum over all regions.

    Parameters
    ----------
    parts : sequence
        Of each region: its interface, the sites of its atoms, and their stiffness.
    unit : float
        Mechanical unit of the stiffness.
    """
    dim = grid.dim
    free = [interface.depth(x) > 0.0 for interface, x, _ in parts]
    first, count = 0, sum(int(each.sum()) for each in free)
    size = (count + grid.size) * dim
    total = sparse.csr_array((size, size))
    for (interface, x, K), loose in zip(parts, free, strict=True):
        onto = _motions(grid, shift, interface, x, loose, first, count)
        total = total + onto.T @ (unit * K) @ onto
        first += int(loose.sum())
    x = np.concatenate([x[loose] for (_, x, _), loose in zip(parts, free, strict=True)])
    return Stiffness(x, sparse.csr_array(total))


def _motions(
    grid: BackgroundGrid,
    shift: InnerShift | None,
    interface: Interface,
    x: Floats,
    free: Bools,
    first: int,
    count: int,
) -> sparse.csr_array:
    """How the freedoms move the atoms of a region, whose first free atom has a number."""
    dim, nodes = grid.dim, np.flatnonzero(grid.canonical())
    functions = ShapeFunctions(grid, nodes, interface.half_widths(grid), shift)
    ghosts, stencils, _ = functions.marked((~free).astype(np.int32), 1, x)
    own = np.flatnonzero(free)
    atoms = _columns(own, first + np.arange(own.size), (len(x), count + grid.size), dim)
    spread = _columns(ghosts, np.arange(ghosts.size), (len(x), ghosts.size), dim)
    at = _columns(np.arange(nodes.size), count + nodes, (nodes.size, count + grid.size), dim)
    return sparse.csr_array(atoms + spread @ stencils.matrix(nodes.size, dim) @ at)


def _columns(rows: Ints, columns: Ints, shape: tuple[int, int], dim: int) -> sparse.csr_array:
    """Ones, the same for each of d components."""
    ones = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)
    return sparse.csr_array(sparse.kron(ones, sparse.eye_array(dim), format="csr"))
