"""Schemes with planes on the continuum's side: atoms push nodes, nodal velocities go back.

Ghost atoms move with the nodes, so the forces on them belong to the nodes with the same weights. In
the force scheme these are the forces of the free atoms, and the part of their bonds that the
continuum already contains is subtracted (``interface``). In the sites scheme the ghosts between the
two planes are the stiffness there, and the points have none (``sites``). All of this
derives from one energy of the free atoms and the nodal displacements,
and the steps are those of leapfrog, so energy is conserved.

The scheme works with any ``ContinuumSolver``.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from msgspec.structs import replace

from gimpmd_gimp.coupling.interface.bonds import find_bonds
from gimpmd_gimp.coupling.interface.bonds import join as join_bonds
from gimpmd_gimp.coupling.interface.correction import correct, near_planes
from gimpmd_gimp.coupling.interface.correction import join as join_corrections
from gimpmd_gimp.coupling.interface.lattice import STRAIN, Lattice, make_lattice, mismatch
from gimpmd_gimp.coupling.interface.terms import LinearTerms, Terms, make_terms
from gimpmd_gimp.coupling.sites.layout import Layout
from gimpmd_gimp.coupling.sites.terms import site_terms
from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_gimp.laws import LatticeSum, Law
from gimpmd_gimp.laws.law import kernel
from gimpmd_gimp.points.material_points import MaterialPoints, join, take
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.interface_nodes import interface_nodes
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import TOTAL, Array, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding, check

log = logging.getLogger(__name__)

MISMATCH = 0.1
"""Difference between law and crystal, as a share, from which the log has a warning.

If the moduli at rest differ so much, it is a finding: the continuum is another material.

Strains jump at the planes by about this relative difference. The effect on waves is smaller: the
reflected fraction of the energy is the square of a quarter of the relative difference of the
moduli, 6e-4 here.
"""

_NODES, _SHARED = "interface", "shared"
"""Names in a saved state: nodes of the interface, and nodes that both sides move."""


class Evaluated(Protocol):
    """An energy of nodal displacements."""

    @property
    def nodes(self) -> Ints:
        """Ids of the nodes."""
        ...

    def evaluate(self, U: Floats) -> tuple[float, Floats]:
        """Energy and nodal forces at displacements ``(n, d)`` of the nodes."""
        ...


class ForceScheme:
    """Couples nodes to the atoms by forces that act in the kicks of the continuum; see ``Scheme``.

    Parameters
    ----------
    plan : Plan
        With crystal and planes.
    solver : ContinuumSolver
        Its continuum ends at the planes.
    layout : Layout, optional
        Of the interface, in the sites scheme.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes whose fields this rank sends and receives.
    notes : tuple of str
        What the user should know of the interface.

    Raises
    ------
    BackendError
        The interface touches nodes that this rank does not hold.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, plan: Plan, solver: ContinuumSolver, layout: Layout | None = None) -> None:
        self._solver = solver
        if layout is None:
            lattice = _lattice(plan)
            self._terms: Evaluated = _terms(plan, solver, lattice)
            self._misfit = _misfit(solver, lattice)
        else:
            self._terms, moduli, self.notes = site_terms(plan, layout, solver)
            self._misfit = check("stiffness", moduli, MISMATCH) if _is_first(solver) else ()
        self._every = plan.energies_every
        self._nodes = solver.rows(self._terms.nodes)
        if (self._nodes < 0).any():
            raise BackendError(
                "the interface touches nodes that this rank does not hold: its patch is too narrow "
                "for the bonds; use fewer continuum.ranks"
            )
        shared = interface_nodes(plan)
        rows = solver.rows(shared)
        own = (rows >= 0) & solver.counted(rows)
        self.offers = self.needs = shared[own]
        self._shared = rows[own]
        self._displacement = initial_state(plan, solver.positions(self._nodes))[0]
        self._velocity = solver.velocity(self._shared)
        self._moved = np.zeros_like(self._velocity)  # of the shared nodes in the last step
        self._force = np.zeros_like(self._velocity)
        self._work = self._strain = 0.0
        self._energy, self._interface_force = self._terms.evaluate(self._displacement)
        self._energies: Energies | None = None
        self._step_is_pending = False
        solver.add_nodal_forces(self.add_impulse)

    def add_impulse(self, span: float, J: Floats) -> None:
        """Add the impulse of atoms and interface over ``span`` to ``J``; see ``AddImpulse``."""
        _add_rows(J, self._shared, span, self._force)
        _add_rows(J, self._nodes, span, self._interface_force)

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the ghost atoms."""
        return {"velocity": self._velocity}

    def finish(self) -> None:
        """Complete the step, evaluate the interface, and prepare the next step."""
        self._solver.end_step()
        self._energy, self._interface_force = self._terms.evaluate(self._displacement)
        if self._energies_are_due():
            self._strain = self._solver.note_energies()
        self._solver.prepare()

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the present forces of the atoms, ``force`` of shape ``(n, d)`` on ``needs``."""
        force = fields["force"]
        self._work += 0.5 * float(((self._force + force) * self._moved).sum())
        self._force = np.array(force)
        self._step_is_pending = True

    def advance(self) -> None:
        """Take a step as far as the atoms need it, and add up the displacements of the nodes."""
        solver, due = self._solver, self._energies_are_due()
        solver.start_step()
        self._displacement += solver.dt * solver.velocity(self._nodes)
        self._velocity = solver.velocity(self._shared)
        self._moved = solver.dt * self._velocity
        self._step_is_pending = False
        self._energies = self._with_interface(solver.noted_energies()) if due else None

    def energies(self) -> Energies | None:
        """See ``Scheme``. At the last step a part of the next kick leads to the present time."""
        if not self._step_is_pending:
            return self._energies
        if not self._energies_are_due():
            return None
        return self._with_interface(self._solver.present_energies())

    def state(self) -> dict[str, Array]:
        """Motion and forces of the nodes at the interface, work and strain energy."""
        return {
            _NODES + "/ids": self._terms.nodes,
            _NODES + "/displacement": self._displacement,
            _SHARED + "/ids": self.offers,
            _SHARED + "/velocity": self._velocity,
            _SHARED + "/moved": self._moved,
            _SHARED + "/force": self._force,
            TOTAL + "interface_work": np.asarray(self._work),
            TOTAL + "strain": np.asarray(self._strain),
        }

    def restore(self, saved: SavedStates) -> None:
        """Take the state, evaluate the interface, and prepare the next step."""
        self._displacement = saved.by_id(
            _NODES + "/displacement", _NODES + "/ids", self._terms.nodes
        )
        self._velocity, self._moved, self._force = (
            saved.by_id(f"{_SHARED}/{name}", f"{_SHARED}/ids", self.offers)
            for name in ("velocity", "moved", "force")
        )
        self._work, self._strain = (float(saved.total(n)) for n in ("interface_work", "strain"))
        self._energy, self._interface_force = self._terms.evaluate(self._displacement)
        self._solver.prepare()

    def misfit(self) -> tuple[Finding, ...]:
        """Whether the moduli of the continuum are not those of the crystal, on the first rank."""
        return self._misfit

    def _energies_are_due(self) -> bool:
        return self._solver.steps % self._every == 0

    def _with_interface(self, energies: Energies) -> Energies:
        """Energies with those of the interface."""
        return replace(energies, potential=self._strain + self._energy, interface_work=self._work)


@kernel
def _add_rows(J: Floats, rows: Ints, span: float, force: Floats) -> None:
    """``J[rows] += span force``; no row occurs twice."""
    for k in range(rows.size):
        for axis in range(force.shape[1]):
            J[rows[k], axis] += span * force[k, axis]


def _lattice(plan: Plan) -> Lattice:
    """The crystal that the continuum meets at the planes."""
    crystal = plan.coupled.crystal
    if crystal is None:
        raise ValueError("the crystal at the interface has not been found yet")
    to_mechanical = UNITS[plan.units].energy_to_mechanical(1.0)
    return make_lattice(crystal, to_mechanical, plan.thermal_energy())


def _terms(plan: Plan, solver: ContinuumSolver, lattice: Lattice) -> Terms | LinearTerms:
    """Energy of the interfaces of all MD regions, this rank's part; collective.

    The regions are so far apart that no point and no bond belongs to two of them.
    """
    coupling, grid = plan.coupled, plan.background_grid()
    points, bonds, corrections = solver.points_at_rest(), [], []
    for interface in coupling.interfaces:
        bonds.append(find_bonds(lattice, interface, grid))
        near = _near(solver, points, interface, grid.cell)
        corrections.append(correct(near, lattice, bonds[-1], interface, grid))
    rods, correction = join_bonds(bonds), join_corrections(corrections)
    terms = make_terms(rods, correction, lattice, grid).take(
        solver.owns(rods.crossing), np.isin(correction.id, points.id)
    )
    return terms if solver.law.finite else terms.linear()


def _misfit(solver: ContinuumSolver, lattice: Lattice) -> tuple[Finding, ...]:
    """Compare the continuum with the crystal, on the first rank: log and finding."""
    if not _is_first(solver):
        return ()
    law = solver.law
    moduli, stress = mismatch(lattice, law)
    if not isinstance(law, LatticeSum):  # such a law is the sum over the bonds of a crystal
        _log_mismatch(law, moduli, stress)
    return check("stiffness", moduli, MISMATCH)


def _is_first(solver: ContinuumSolver) -> bool:
    return solver.comm is None or solver.comm.rank == 0


def _log_mismatch(law: Law, moduli: float, stress: float) -> None:
    log.log(
        logging.WARNING if max(moduli, stress) > MISMATCH else logging.INFO,
        "the continuum (%s) differs from the crystal that it meets at the planes: its moduli at "
        "rest are off by %.1f %%, its stress at %g %% strain by up to %.1f %%; strains jump "
        "there by about as much. To use the bonds of the crystal, set continuum.material to "
        "from: md and model: cauchy-born",
        law.name,
        100.0 * moduli,
        100.0 * STRAIN,
        100.0 * stress,
    )


def _near(
    solver: ContinuumSolver, points: MaterialPoints, interface: Interface, cell: float
) -> MaterialPoints:
    """Points of all ranks near the planes."""
    near = take(points, near_planes(points, interface, cell))
    return near if solver.comm is None else join(solver.comm.allgather(near))
