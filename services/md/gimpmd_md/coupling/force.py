"""The force scheme: ghost atoms move with the nodes and hand back the forces on them.

Both directions use the same weights, linear hats at lattice positions, so what leaves the atoms
arrives at the continuum: ``sum_i F_i V_i = sum_a f_a v_a``.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.absorber import Absorber
from gimpmd_md.coupling.halo import Halo
from gimpmd_md.coupling.scheme import BOUNDARY, CORE, PROJECTED
from gimpmd_md.coupling.shape_functions import ShapeFunctions, Stencils
from gimpmd_md.crystal.check import check_crystal
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.planes import Interface, interfaces_of
from gimpmd_schemas.grid.zones import owners
from gimpmd_schemas.mechanics.initial_state import initial_state
from gimpmd_schemas.mechanics.units import UNITS


class ForceExchange:
    """Nodal forces of ghost atoms against nodal velocities; see ``exchange.Exchange``.

    Parameters
    ----------
    case : Case
        With its planes found; a run of one side alone has none.
    engine : Engine
    cutoff : float
        Range of the potential.
    """

    def __init__(self, case: Case, engine: Engine, cutoff: float) -> None:
        self._case, self._engine, self._cutoff = case, engine, cutoff
        self._interfaces = (
            interfaces_of(case)
            if case.only is None
            else (Interface(((-np.inf, np.inf), (-np.inf, np.inf)), case.md_region()),)
        )
        self._force_unit = UNITS[case.units].force_to_mechanical(1.0)
        grid, region, counts = case.background_grid(), case.md_region(), case.md_patches()
        comm, x = engine.comm, grid.positions()
        ghostly = np.unique(np.concatenate([i.ghost_nodes(grid) for i in self._interfaces]))
        self._halo = Halo(comm, grid, region, counts, ghostly)
        self.needs = self._halo.nodes
        self.offers = ghostly[owners(region, counts, x[ghostly]) == comm.rank]
        self.bonded = CORE | BOUNDARY  # bonds of free atoms with ghosts, both halves
        self._hats = ShapeFunctions(grid, self.needs)
        self._halo.connect(self._hats.rows, width=2)
        self._offered = self._hats.rows(self.offers)
        settings = case.coupling.absorber
        self._absorber = Absorber(case, settings, engine, self._interfaces) if settings else None
        self._at_start = initial_state(case, x[self.needs])[:2]

    def parts(self, x: Floats) -> Ints:
        """Ghosts outside the planes, free atoms inside.

        Raises
        ------
        BackendError
            The atoms near the planes are not the crystal of the case.
        """
        if self._case.only is None:
            check_crystal(self._case, self._cutoff, x, self._engine.comm)
        free = np.any([interface.free(x) for interface in self._interfaces], axis=0)
        part = np.where(free, CORE, BOUNDARY)
        if self._absorber is not None:
            part |= np.where(self._absorber.contains(x), PROJECTED, 0)
        return part

    def initial_state(self) -> tuple[Floats, Floats]:
        """Free atoms as the case says; ghosts as the nodes have it."""
        u, v, _ = initial_state(self._case, self._engine.pairs("d2_gimpmd_rest"))
        places, hats = self._ghosts()
        for nodal, field in zip(self._at_start, (u, v), strict=True):
            field[places] = hats.interpolate(nodal)
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Interpolate the velocities of ghosts, ``v_a = sum_i S_ia V_i``; damp the band."""
        places, hats = self._found  # by `fields`: atoms stand where they stood
        self._engine.pairs("v")[places] = hats.interpolate(velocity)
        if self._absorber is not None:
            self._absorber.apply()

    def fields(self, span: float) -> dict[str, Floats]:
        """Forces that free atoms exert on ghosts now, ``F_i = sum_a S_ia f_a``, mechanical."""
        places, hats = self._found = self._ghosts()
        sums = hats.gather(self._engine.pairs("f")[places], self.needs.size)
        self._halo.complete(sums)
        return {"force": self._force_unit * sums[self._offered]}

    def dissipated(self) -> float:
        """What the absorber has taken out."""
        return 0.0 if self._absorber is None else self._absorber.dissipated

    def _ghosts(self) -> tuple[Ints, Stencils]:
        """Places of the ghosts among the local atoms, and their stencils."""
        engine = self._engine
        part, lattice = engine.atoms("i_gimpmd_part"), engine.pairs("d2_gimpmd_lattice")
        return self._hats.marked(part, BOUNDARY, lattice)
