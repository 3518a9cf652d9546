"""Schemes with planes: ghost atoms move with the nodes and return the forces that act on them.

Both directions use the same weights, hat functions at lattice positions, so the power that leaves
the atoms arrives at the continuum: ``sum_i F_i V_i = sum_a f_a v_a``.

In the force scheme the forces are those of the free atoms. In the sites scheme they are minus the
derivatives of the energies of active sites, so those of the ghosts between the planes count too.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.absorber import Absorber
from gimpmd_md.coupling.site_stencils import SiteStencils
from gimpmd_md.crystal.check import check_crystal
from gimpmd_md.crystal.inner_shift import of_plan, shifts
from gimpmd_md.engines.atoms import Array, Atoms
from gimpmd_md.roles import BOUNDARY, CORE, OFF, PROJECTED
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state, velocity_gradient
from gimpmd_schemas.case.interface_nodes import interface_nodes
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import TOTAL, SavedStates
from gimpmd_schemas.mechanics.units import UNITS

_ABSORBER = "absorber/"
"""Names in a saved state."""


class ForceScheme:
    """Nodal forces of ghost atoms against nodal velocities; see `scheme.Scheme`.

    Parameters
    ----------
    plan : Plan
        Of a coupled run.
    atoms : Atoms
        At their lattice positions.
    """

    bonded = CORE | BOUNDARY  # bonds between free atoms and ghosts, both halves
    sees_paths = False

    def __init__(self, plan: Plan, atoms: Atoms) -> None:
        self._plan, self._atoms = plan, atoms
        self._interfaces = plan.coupled.interfaces
        self._force_unit = UNITS[plan.units].force_to_mechanical(1.0)
        grid = plan.background_grid()
        self._nodes = grid.positions()
        sites = plan.coupled.sites
        half = None if sites is None else self._interfaces[0].half_widths(grid)
        self._shift = None if sites is None else of_plan(sites)
        self._ghosts = SiteStencils(plan, atoms, BOUNDARY, interface_nodes(plan), half, self._shift)
        self._halo = self._ghosts.halo
        self.offers, self.needs = self._halo.own, self._halo.home
        self._absorber: Absorber | None = None
        if plan.coupled.absorber is not None:
            self._absorber = Absorber(plan, plan.coupled.absorber, atoms, self.offers)
            self._seen, self._pushed = (
                np.searchsorted(ids, self._absorber.nodes) for ids in (self.needs, self.offers)
            )
        self._velocity = np.zeros((self.needs.size, plan.dim))

    @property
    def dissipated(self) -> float:
        """Energy that the absorber has taken out."""
        return 0.0 if self._absorber is None else self._absorber.dissipated

    @property
    def work_of_nodes(self) -> float:
        """Work that nodes have done on the absorber."""
        return 0.0 if self._absorber is None else self._absorber.from_nodes

    def roles(self) -> Ints:
        """Free atoms inside the planes, ghosts outside; sites beyond second planes are off.

        Raises
        ------
        BackendError
            The atoms near the planes are not the crystal of the case.
        """
        atoms, by_sites = self._atoms, self._plan.coupled.sites is not None
        if not by_sites:
            check_crystal(self._plan, atoms.cutoff, atoms.site, atoms.comm)
        free = np.any([interface.free(atoms.site) for interface in self._interfaces], axis=0)
        role = np.where(free, CORE, BOUNDARY)
        if by_sites:
            off = np.all([interface.off(atoms.site) for interface in self._interfaces], axis=0)
            role |= np.where(off, OFF, 0)
        if self._absorber is not None:
            role |= np.where(self._absorber.contains(atoms.site), PROJECTED, 0)
        return role

    def initial_state(self) -> tuple[Floats, Floats]:
        """The initial state of the case for free atoms, interpolated from the nodes for ghosts.

        Free atoms have the inner shifts of the crystal too.
        """
        rest = self._atoms.rest
        u, v, gradient = initial_state(self._plan, rest)
        if self._shift is not None:
            kappa = self._shift.at(self._atoms.site)
            u += shifts(kappa, gradient)
            v += shifts(kappa, velocity_gradient(self._plan, rest))
        rows, stencils = self._ghosts.find()
        at_nodes = initial_state(self._plan, self._nodes[self._halo.nodes])
        for nodal, field in zip(at_nodes, (u, v), strict=False):
            field[rows] = stencils.interpolate(nodal)
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Interpolate the velocities of the ghosts, ``v_a = sum_i S_ia V_i``."""
        rows, stencils = self._ghosts.find()
        self._atoms.v[rows] = stencils.interpolate(self._halo.distribute(velocity))
        self._velocity = velocity
        if self._absorber is not None:
            self._absorber.settle(velocity[self._seen])

    def fields(self, span: float) -> dict[str, Floats]:
        """Forces on ghosts now, ``F_i = sum_a S_ia f_a`` (mechanical units); damp the band.

        The nodes' share of the damping is an impulse, which acts as a force over the next step.
        """
        rows, stencils = self._ghosts.find()
        sums = self._ghosts.sums(stencils, self._atoms.f[rows])
        force = self._force_unit * sums[self._halo.rows(self.offers)]
        if self._absorber is not None and span > 0.0:
            self._absorber.apply(self._velocity[self._seen])
            force[self._pushed] += self._absorber.impulse / span
        return {"force": force}

    def state(self) -> dict[str, Array]:
        """The energy that the absorber has taken out, and its last impulse on the nodes."""
        if self._absorber is None:
            return {}
        return {
            _ABSORBER + "ids": self._absorber.nodes,
            _ABSORBER + "impulse": self._absorber.impulse,
            TOTAL + "dissipated": np.asarray(self.dissipated),
            TOTAL + "work_of_nodes": np.asarray(self.work_of_nodes),
        }

    def restore(self, saved: SavedStates) -> None:
        """Set the absorber to the step, and to what it has taken out and pushed."""
        if self._absorber is not None:
            self._absorber.go_on(
                saved.step,
                saved.by_id(_ABSORBER + "impulse", _ABSORBER + "ids", self._absorber.nodes),
                *(float(saved.total(name)) for name in ("dissipated", "work_of_nodes")),
            )
