"""Scheme F on the continuum's side: forces of the atoms act on nodes, nodal velocities go back.

Ghost atoms move with the nodes, so the forces that free atoms exert on them belong to the nodes by
the same weights; the part of their bonds that the continuum already is gets subtracted
(``interface``). All of it derives from one energy of free atoms and nodal displacements, and steps
are those of leapfrog: energy is conserved.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from gimpmd_gimp.coupling.interface.bonds import find_bonds
from gimpmd_gimp.coupling.interface.bonds import join as join_bonds
from gimpmd_gimp.coupling.interface.correction import correct, near_planes
from gimpmd_gimp.coupling.interface.correction import join as join_corrections
from gimpmd_gimp.coupling.interface.lattice import STRAIN, Lattice, make_lattice, mismatch
from gimpmd_gimp.coupling.interface.terms import LinearTerms, Terms, make_terms
from gimpmd_gimp.coupling.scheme import Books, find_nodes, sum_up
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LatticeSum, Law
from gimpmd_gimp.points.distribution import nearest_patch
from gimpmd_gimp.points.material_points import MaterialPoints, join, take
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface, interfaces_of
from gimpmd_schemas.mechanics.initial_state import initial_state
from gimpmd_schemas.mechanics.units import UNITS

log = logging.getLogger(__name__)

MISMATCH = 0.1
"""Share by which a law may be off the crystal before it is worth a warning.

Strains jump at the planes by about as much. Waves mind less: of a wave's energy the square of a
quarter of the moduli's share comes back, 6e-4 here.
"""


class ForceExchange:
    """Ties nodes to the atoms by forces, in the solver's kicks; see ``exchange.Exchange``.

    Parameters
    ----------
    case : Case
        With crystal and planes.
    solver : Solver
        In the reference configuration, its points cut at the planes.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes that this rank sends and wants.
    """

    def __init__(self, case: Case, solver: Solver) -> None:
        mesh, grid, interfaces = solver.mesh, case.background_grid(), interfaces_of(case)
        self._solver, self._terms = solver, _terms(case, solver, grid, interfaces)
        self._every = case.energies_every()
        self._nodes = find_nodes(solver, grid, self._terms.nodes)
        if (self._nodes < 0).any():
            raise BackendError(
                "the interface touches nodes that this rank does not hold: its patch is too narrow "
                "for the bonds; use fewer continuum.ranks"
            )
        ghosts = np.unique(np.concatenate([i.ghost_nodes(grid) for i in interfaces]))
        held = find_nodes(solver, grid, ghosts)
        own = (held >= 0) & (mesh.counts[held] > 0.0)
        self.offers = self.needs = ghosts[own]
        self._shared = held[own]
        self._U = initial_state(case, mesh.positions()[self._nodes])[0]
        self._way = np.zeros((self._shared.size, 2))
        self._force, self._velocity = np.zeros_like(self._way), solver.V[self._shared]
        self._work = self._strain = self._mass = self._dissipated = 0.0
        self._energy, self._tie = self._terms.evaluate(self._U)
        self._books: Books | None = None
        self._waiting = False  # for a step, whose kick makes the books exact
        solver.nodal_forces = self

    def add(self, span: float, J: Floats) -> None:
        """Add the impulse of atoms and interface over ``span`` to ``J``; see ``NodalForces``."""
        J[self._shared] += span * self._force
        J[self._nodes] += span * self._tie

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the ghost atoms."""
        return {"velocity": self._velocity}

    def finish(self) -> None:
        """End the step, sum up strain energy and mass, and prepare the next step."""
        solver = self._solver
        solver.end_step()
        self._energy, self._tie = self._terms.evaluate(self._U)
        if solver.steps % self._every == 0:
            self._strain, self._mass = solver.strain_energy().tolist()
            self._dissipated = solver.dissipation()
        solver.prepare()

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the forces of the atoms now, ``force`` of shape ``(n, 2)`` on ``needs``."""
        force = fields["force"]
        self._work += 0.5 * float(((self._force + force) * self._way).sum())
        self._force = np.array(force)
        self._waiting = True

    def advance(self) -> None:
        """Take a step of GIMP as far as the atoms need it, and note how the nodes have moved."""
        solver, before = self._solver, self._solver.external_work
        due, first = solver.steps % self._every == 0, solver.steps == 0
        solver.start_step()
        V = solver.V
        self._U += solver.dt * V[self._nodes]
        self._velocity = V[self._shared]
        self._way = solver.dt * self._velocity
        self._waiting, self._books = False, None
        if due:
            # the kick's middle is the time at which the step began
            kinetic, *momentum = solver.kick_sums.tolist()
            work = before if first else 0.5 * (before + solver.external_work)
            strain = self._strain + self._energy
            works = work, self._work, self._dissipated
            self._books = Books(kinetic, strain, self._mass, tuple(momentum), *works)

    def books(self) -> Books | None:
        """Exact sums at the time of the last ``finish``; at the stop by a kick to the present."""
        if self._waiting:
            last = sum_up(self._solver, "all", self._every, exact=True)
            strain = self._strain + self._energy
            return last and last._replace(strain=strain, interface_work=self._work)
        return self._books

    def dissipated(self) -> float:
        """Nothing: the exchange conserves energy."""
        return 0.0


def _terms(
    case: Case, solver: Solver, grid: BackgroundGrid, interfaces: tuple[Interface, ...]
) -> Terms | LinearTerms:
    """Energy of the interfaces of all MD regions, this rank's part; collective.

    Regions are so far apart that no point, and no bond, belongs to two of them.
    """
    mesh, crystal = solver.mesh, case.coupling.crystal
    if crystal is None:
        raise ValueError("the crystal at the interface has not been found yet")
    lattice = make_lattice(crystal, UNITS[case.units].energy_to_mechanical(1.0), case.heat())
    if mesh.rank == 0:
        _compare(solver.law, lattice)
    bonds, corrections = [], []
    for interface in interfaces:
        bonds.append(find_bonds(lattice, interface, grid))
        points = _near(mesh, solver.points, interface, grid.cell)
        corrections.append(correct(points, lattice, bonds[-1], interface, grid))
    rods, correction = join_bonds(bonds), join_corrections(corrections)
    terms = make_terms(rods, correction, lattice, grid).take(
        nearest_patch(mesh, mesh.hierarchy.top, rods.crossing)[0] == mesh.rank,
        np.isin(correction.id, solver.points.id),
    )
    return terms if solver.law.finite else terms.linear()


def _compare(law: Law, lattice: Lattice) -> None:
    """Log how far the continuum is from the crystal, unless it is the sum over its bonds."""
    if isinstance(law, LatticeSum):
        return
    moduli, stress = mismatch(lattice, law)
    log.log(
        logging.WARNING if max(moduli, stress) > MISMATCH else logging.INFO,
        "the continuum (%s) is not quite the crystal that it meets at the planes: its moduli at "
        "rest are off by %.1f %%, its stress at %g %% strain by up to %.1f %%, and strains jump "
        "there by about as much; the crystal's own bonds are continuum.material with from: md and "
        "model: cauchy-born",
        law.name,
        100.0 * moduli,
        100.0 * STRAIN,
        100.0 * stress,
    )


def _near(mesh: Mesh, points: MaterialPoints, interface: Interface, cell: float) -> MaterialPoints:
    """Points of all ranks near the planes."""
    near = take(points, near_planes(points, interface, cell))
    return near if mesh.ranks == 1 else join(mesh.comm.allgather(near))
