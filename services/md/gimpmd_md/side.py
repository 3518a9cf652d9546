"""The atoms' side of the coupling on one rank: the coupling step with any MD code and scheme."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_coupler.loop import Timings
from gimpmd_md.coupling.cutoff import check_cutoff
from gimpmd_md.coupling.force import ForceScheme
from gimpmd_md.coupling.halo import own_patch
from gimpmd_md.coupling.monitors import Monitors
from gimpmd_md.coupling.scheme import Scheme, Uncoupled
from gimpmd_md.coupling.velocity import VelocityScheme
from gimpmd_md.engines.atoms import Array, Atoms
from gimpmd_md.loads import Loads
from gimpmd_md.roles import BOUNDARY, CORE
from gimpmd_md.sums import power_of, spacing_of, tally
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import TOTAL, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.registry import load_code
from gimpmd_schemas.wire.energies import Energies, from_array, to_array
from gimpmd_schemas.wire.findings import Finding, monitors_look

FORCE_TOLERANCE = 1e-6
"""Relaxation ends when no force is larger than this times C11 times the spacing."""

OFFERS, FIELD = "side/offers", "side/field/"
"""Names in a saved state."""


class MdSide:
    """The atoms of one rank in a coupled run; implements `gimpmd_coupler.loop.Side`.

    In a coupling step the boundary atoms get velocities, the MD code takes N steps, and the scheme
    computes the fields that the continuum needs. Work, energies and the positions at the start of
    the next step follow in `finish`, while the fields are on their way.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
        At their lattice positions. The side closes them.
    saved : SavedStates, optional
        The checkpoint from which the run goes on.

    Attributes
    ----------
    atoms : Atoms
    offers, needs, timings
        See `gimpmd_coupler.loop.Side`.

    Raises
    ------
    BackendError
        The atoms do not fit the plan.
    """

    def __init__(self, plan: Plan, atoms: Atoms, saved: SavedStates | None = None) -> None:
        self._plan, self.atoms = plan, atoms
        self._units = UNITS[plan.units]
        spacing = _spacing(plan, atoms)
        self._scheme = _make_scheme(plan, atoms, spacing)
        self._loads = Loads(plan, atoms, spacing)
        self._monitors = Monitors(plan, atoms)
        self.offers, self.needs = self._scheme.offers, self._scheme.needs
        self.timings = Timings()
        self._step = saved.step if saved else 0
        self._interface_work = 0.0
        self._boundary: Ints = np.empty(0, dtype=np.int64)  # rows of the boundary atoms
        self._migrations: int | None = None  # of the atoms when these were found
        self._energies: Energies | None = None
        self._findings: tuple[Finding, ...] = ()
        self._at_rest = np.zeros((self.needs.size, plan.dim))
        self._velocity = self._at_rest  # of the nodes in `needs`
        self._set_up(spacing, saved)
        self._fields = self._scheme.fields(0.0)
        if saved:
            self._restore(saved)

    def _set_up(self, spacing: float, saved: SavedStates | None) -> None:
        """Give the atoms their roles, relax them, and set the initial state."""
        atoms, loads = self.atoms, self._loads
        role = self._scheme.roles()
        role |= loads.roles((role & BOUNDARY) == 0)
        role |= self._monitors.roles()
        atoms.role[:] = role
        bonded = self._scheme.bonded  # forces on ghost atoms reach the nodes
        tolerance = _force_tolerance(self._plan, spacing)
        atoms.settle(loads.springs, loads.loaded, bonded, tolerance, saved)
        loads.balance()
        u, v = self._scheme.initial_state()
        atoms.x[:] += u
        atoms.v[:] += v
        atoms.start()
        if self._plan.initial.stretch is not None:
            loads.balance()
        self._note_positions()

    def zone_fields(self) -> dict[str, Floats]:
        """Fields of the scheme on ``offers`` at the end of the last coupling step."""
        return self._fields

    def finish(self) -> None:
        """Add the work of the coupling step that has ended, and tally the energies; call once.

        At some of the steps with energies the monitors look at the atoms.
        """
        with self.timings.phase("finish"):
            if self._step:
                self._add_work_of_motion(0.5 * self._plan.step)
                self._loads.add_work()
                self._note_positions()
            self._energies = self._tally()
        self._look()

    def write(self, time: float) -> None:
        """Do nothing: the MD code writes its own output during `advance`."""

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the velocities of the nodes in ``needs``; without them the nodes are at rest."""
        self._velocity = fields.get("velocity", self._at_rest)

    def advance(self) -> None:
        """Take one coupling step: N steps of the MD code.

        Raises
        ------
        BackendError
            The MD code stopped, or an atom left the grid.
        """
        plan, start = self._plan, self._step * self._plan.step
        with self.timings.phase("drive"):
            self._scheme.drive(self._velocity)
            self._loads.apply(start, start + plan.step)
            self._add_work_of_motion(0.5 * plan.step)
        with self.timings.phase(plan.atoms.backend):
            self.atoms.run(plan.atoms.steps)
        with self.timings.phase("project"):
            self._step += 1
            self._fields = self._scheme.fields(plan.step)

    def energies(self) -> Energies | None:
        """Conserved quantities of this rank's atoms on the atoms' side of the interface.

        They belong to the step of the last `finish`; None at steps without energies.
        """
        return self._energies

    def findings(self) -> tuple[Finding, ...]:
        """What the monitors found at the last `finish`."""
        return self._findings

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user must know about the results, in sentences of the MD code."""
        return self.atoms.notes

    def renew(self) -> None:
        """Let the MD code make neighbour lists and forces anew."""
        self.atoms.renew()

    def state(self) -> dict[str, Array]:
        """Atoms, fields on the nodes, works, and what is to be reported at this step."""
        state = {**self.atoms.state(), **self._scheme.state(), OFFERS: self.offers}
        state |= self._monitors.state()
        state |= {FIELD + name: field for name, field in self._fields.items()}
        state[TOTAL + "interface_work"] = np.asarray(self._interface_work)
        state[TOTAL + "load_work"] = np.asarray(self._loads.work)
        if self._energies is not None:
            state[TOTAL + "energies"] = to_array(self._energies)
        return state

    def _restore(self, saved: SavedStates) -> None:
        """Go on from a checkpoint, in which the step has been finished."""
        self.atoms.restore(saved)
        self._scheme.restore(saved)
        self._fields = {
            name: saved.by_id(FIELD + name, OFFERS, self.offers) for name in self._fields
        }
        self._interface_work = float(saved.total("interface_work"))
        self._loads.work = float(saved.total("load_work"))
        due = self._step % self._plan.energies_every == 0
        self._energies = from_array(saved.total("energies")) if due else None
        self._monitors.restore(saved.any)
        self._look()

    def close(self) -> None:
        """Close the MD code and its files."""
        self.atoms.close()

    def _add_work_of_motion(self, span: float) -> None:
        """Add the work of the boundary atoms' motion over a time, with the present forces."""
        atoms = self.atoms
        if atoms.migrations != self._migrations:
            self._boundary = np.flatnonzero(atoms.role & np.int32(BOUNDARY))
            self._migrations = atoms.migrations
        self._interface_work -= span * power_of(self._boundary, atoms.v, atoms.f)

    def _note_positions(self) -> None:
        """Store the positions at which the next coupling step starts, if anyone asks for them."""
        if not self._scheme.sees_paths:
            self._loads.note_positions()
            return
        x, last = self.atoms.x, self.atoms.last
        for axis in range(self._plan.dim):  # three times as fast as all axes at once
            last[:, axis] = x[:, axis]

    def _look(self) -> None:
        """Let the monitors look, if it is time."""
        self._findings = ()
        if self._energies is not None and monitors_look(self._plan, self._step):
            with self.timings.phase("monitors"):
                self._findings = self._monitors.look(self._step, self._energies)

    def _tally(self) -> Energies | None:
        if self._step % self._plan.energies_every:
            return None
        atoms, scheme = self.atoms, self._scheme
        mass, momentum, twice_kinetic, potential = tally(
            atoms.role, CORE, atoms.mass, atoms.v, scheme.bonded, atoms.potential
        )
        return Energies(
            kinetic=self._units.energy_from_mechanical(0.5 * twice_kinetic),
            potential=potential,
            external_work=self._loads.work,
            fix_work=atoms.fix_work,
            interface_work=self._interface_work + scheme.work_of_nodes,
            dissipated=scheme.dissipated,
            mass=mass,
            momentum=tuple(momentum.tolist()),
        )


def open_side(plan: Plan, comm: Any, run_dir: Path, saved: SavedStates | None = None) -> MdSide:
    """Make the atoms with the MD code that the plan names; collective.

    Parameters
    ----------
    plan : Plan
    comm : mpi4py communicator
    run_dir : Path
        Folder of the run, relative to the working directory, which holds the input files.
    saved : SavedStates, optional
        The checkpoint from which the run goes on.

    Raises
    ------
    BackendError
        The MD code is not installed, the number of ranks is wrong, or the atoms do not fit the
        plan.
    """
    make_atoms = load_code("md", plan.atoms.backend)
    own_patch(plan.atoms.region, plan.atoms.patches, comm)  # as many ranks as patches
    return MdSide(plan, make_atoms(plan, comm, run_dir), saved)


def _make_scheme(plan: Plan, atoms: Atoms, spacing: float) -> Scheme:
    """The scheme of the plan, after a check that the potential suits it."""
    if plan.coupling is None:
        return Uncoupled(plan, atoms)
    coupling = plan.coupling
    check_cutoff(
        plan.atoms.input, atoms.cutoff, atoms.pairwise, coupling.scheme, coupling.zones.outer
    )
    if coupling.scheme in AT_PLANES:
        return ForceScheme(plan, atoms)
    return VelocityScheme(plan, atoms, spacing)


def _spacing(plan: Plan, atoms: Atoms) -> float:
    """Distance of neighbouring atoms; collective.

    Raises
    ------
    BackendError
        It is larger than a cell.
    """
    mass = atoms.comm.allreduce(float(atoms.mass.sum()))
    count = atoms.comm.allreduce(len(atoms.mass))
    spacing = spacing_of(mass, count, plan.continuum.material.density, plan.dim)
    if spacing > plan.finest_cell:
        raise BackendError(
            f"the spacing of the atoms, {spacing:g}, is larger than grid.cell = "
            f"{plan.finest_cell:g}; a cell must span at least one spacing"
        )
    return spacing


def _force_tolerance(plan: Plan, spacing: float) -> float | None:
    """Force at which the atoms count as relaxed (force units); None if they are not relaxed."""
    if not plan.atoms.minimize:
        return None
    stiffness = float(plan.stiffness()[0, 0]) / UNITS[plan.units].nktv2p
    return FORCE_TOLERANCE * stiffness * spacing ** (plan.dim - 1)
