"""The force scheme: ghost atoms move with the nodes and hand back the forces on them.

Both directions use the same weights, linear hats at lattice positions, so what leaves the atoms
arrives at the continuum: ``sum_i F_i V_i = sum_a f_a v_a``.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.absorber import Absorber
from gimpmd_md.crystal_check import check_crystal
from gimpmd_md.engine import Engine
from gimpmd_md.exchange import BOUNDARY, CORE, PROJECTED
from gimpmd_md.halo import Halo
from gimpmd_md.hats import Hats
from gimpmd_schemas.case import Case
from gimpmd_schemas.grid import Floats, Ints
from gimpmd_schemas.initial import initial_state
from gimpmd_schemas.interface import Interface, interface_of
from gimpmd_schemas.units import UNITS
from gimpmd_schemas.zones import owners


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
        self._interface = (
            interface_of(case)
            if case.only is None
            else Interface(((-np.inf, np.inf), (-np.inf, np.inf)), case.md_region())
        )
        self._force_unit = UNITS[case.units].force_to_mechanical(1.0)
        grid, region, counts = case.background_grid(), case.md_region(), case.md_patches()
        comm, x = engine.comm, grid.positions()
        ghostly = self._interface.ghost_nodes(grid)
        self._halo = Halo(comm, grid, region, counts, ghostly)
        self.needs = self._halo.nodes
        self.offers = ghostly[owners(region, counts, x[ghostly]) == comm.rank]
        self.bonded = CORE | BOUNDARY  # bonds of free atoms with ghosts, both halves
        self._hats = Hats(grid, self.needs)
        self._halo.connect(self._rows, width=2)
        self._offered = self._rows(self.offers)
        settings = case.coupling.absorber
        self._absorber = Absorber(case, settings, engine, self._interface) if settings else None
        self._at_start = initial_state(case, x[self.needs])[:2]

    def parts(self, x: Floats) -> Ints:
        """Ghosts outside the planes, free atoms inside.

        Raises
        ------
        BackendError
            The atoms near the planes are not the crystal of the case.
        """
        if self._case.only is None:
            check_crystal(self._case, self._interface, self._cutoff, x, self._engine.comm)
        part = np.where(self._interface.free(x), CORE, BOUNDARY)
        if self._absorber is not None:
            part |= np.where(self._absorber.contains(x), PROJECTED, 0)
        return part

    def initial_state(self) -> tuple[Floats, Floats]:
        """Free atoms as the case says; ghosts as the nodes have it."""
        u, v, _ = initial_state(self._case, self._engine.pairs("d2_gimpmd_rest"))
        for field, out in zip(self._at_start, (u, v), strict=True):
            self._hats.interpolate(*self._ghosts(), field, out)
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Interpolate the velocities of ghosts, ``v_a = sum_i S_ia V_i``; damp the band."""
        self._hats.interpolate(*self._ghosts(), velocity, self._engine.pairs("v"))
        if self._absorber is not None:
            self._absorber.apply()

    def fields(self, span: float) -> dict[str, Floats]:
        """Forces that free atoms exert on ghosts now, ``F_i = sum_a S_ia f_a``, mechanical."""
        sums = np.zeros((self.needs.size, 2))
        self._hats.gather(*self._ghosts(), self._engine.pairs("f"), sums)
        self._halo.complete(sums)
        return {"force": self._force_unit * sums[self._offered]}

    def dissipated(self) -> float:
        """What the absorber has taken out."""
        return 0.0 if self._absorber is None else self._absorber.dissipated

    def _ghosts(self) -> tuple[Ints, int, Floats]:
        """Parts, the bit of ghosts, and lattice positions of the local atoms."""
        engine = self._engine
        return engine.atoms("i_gimpmd_part"), BOUNDARY, engine.pairs("d2_gimpmd_lattice")

    def _rows(self, nodes: Ints) -> Ints:
        """Rows of nodes, by id, in the fields over ``needs``."""
        return np.searchsorted(self.needs, nodes).astype(np.int64)
