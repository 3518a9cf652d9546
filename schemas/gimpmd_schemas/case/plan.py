"""The plan: what runs, with every choice made.

A case says what the user wrote and leaves much open: ``auto``, ``null``, keys left out. ``resolve``
closes all of it once, before a service starts. Services read the plan and nothing else, so two of
them can never choose differently.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

import msgspec

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case import materials
from gimpmd_schemas.case.derive import choices, levels, regions, times
from gimpmd_schemas.case.derive.material import material
from gimpmd_schemas.case.derive.scripts import script_variables
from gimpmd_schemas.case.derive.zones import interfaces_of, zones
from gimpmd_schemas.case.face_parts import FacePart, face_parts
from gimpmd_schemas.case.form import (
    Absorber,
    BodyForce,
    Boundary,
    Case,
    Crack,
    Crystal,
    Damping,
    Domain,
    Initial,
    Packet,
    Role,
    SchemeName,
    Sites,
)
from gimpmd_schemas.case.materials import Material
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.grid.zones import Box, Zones
from gimpmd_schemas.mechanics.elasticity import WaveKind
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.on_disk import write_at_once


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of a plan."""


class MdPlan(_Part, frozen=True):
    """The atoms.

    Attributes
    ----------
    backend : name under which the MD code is registered.
    input, after, files : scripts of the MD code, as in the case.
    variables : for the scripts; see `script_variables`.
    regions : boxes of atoms; the whole domain in a run of MD only.
    region : the box around all atoms, which patches divide.
    cutoff : range of the potential (length units), None in a run without the interface.
    minimize : whether the atoms are relaxed before the run.
    ranks, patches : MPI ranks, and how many patches lie along each axis.
    timestep : time step of the atoms.
    steps : temporal factor N, the MD steps in one coupling step (paper Eq. 17).
    """

    backend: str
    input: str
    after: str | None
    files: tuple[str, ...]
    variables: dict[str, float | str]
    regions: tuple[Box, ...]
    region: Box
    cutoff: float | None
    minimize: bool
    ranks: int
    patches: tuple[int, ...]
    timestep: float
    steps: int


class ContinuumPlan(_Part, frozen=True):
    """The continuum.

    Attributes
    ----------
    backend : name under which the continuum code is registered.
    command : full path and first words of the program of another service; empty: the backend's.
    material : with its numbers.
    temperature : of the thermal stress, or None for no stress at rest.
    points_per_axis : material points in a cell along each axis.
    interpolation, integrator, configuration, dispersion, flip, damping : as in the case; nothing
        is left to choose.
    xpic_order, xpic_every : order of the XPIC filter, and the steps between two uses (0: never).
    body_force, cracks : as in the case.
    ranks, patches, threads : MPI ranks, patches along each axis of every box (None: each box is cut
        as compactly as possible), and threads of each rank;
        ``auto`` threads share the cores of the machine on which the service runs.
    mesh : name of the file with the mesh, in ``input/`` of the run folder; None: no mesh.
    """

    backend: str
    command: tuple[str, ...]
    material: Material
    temperature: float | None
    points_per_axis: int
    interpolation: Literal["linear", "ugimp", "cpgimp", "bspline"]
    integrator: Literal["usavg", "musl", "usf", "usl"]
    configuration: Literal["current", "reference"]
    dispersion: Literal["lumped", "corrected"]
    flip: float
    xpic_order: int
    xpic_every: int
    damping: tuple[Damping, ...]
    body_force: BodyForce | None
    cracks: tuple[Crack, ...]
    ranks: int
    patches: tuple[int, ...] | None
    threads: int | Literal["auto"]
    mesh: str | None = None


class CouplingPlan(_Part, frozen=True):
    """How the two sides are tied together.

    Attributes
    ----------
    scheme : name of the coupling scheme.
    zones : where the MD regions lie in the continuum, and the widths of their zones.
    filter_rate : strength of the zone filter per unit time (velocity scheme).
    crystal : the atoms near the interface (force scheme).
    interfaces : planes about each MD region (force and sites scheme).
    sites : what LAMMPS measured at the planes (sites scheme).
    absorber : of short waves, its rate and width known; or None.
    on_defect : what happens when a monitor has a finding.
    """

    scheme: SchemeName
    zones: Zones
    filter_rate: float
    crystal: Crystal | None
    interfaces: tuple[Interface, ...]
    sites: Sites | None
    absorber: Absorber | None
    on_defect: Literal["warn", "stop"]


class CheckpointPlan(_Part, frozen=True):
    """When the state is saved.

    Attributes
    ----------
    every : coupling steps between the times at which all ranks renew their state (`Plan.renews`).
        Checkpoints are made at these steps.
    seconds : wall time between checkpoints; None: at each of these steps.
    keep : how many checkpoints stay on disk.
    """

    every: int
    seconds: float | None
    keep: int


class Plan(_Part, frozen=True):
    """A whole run, with every choice made.

    Attributes
    ----------
    name, units, domain, boundary, initial : as in the case.
    dim : number of dimensions, 2 or 3.
    level_cells : edge of the cells of each level, level 0 (coarsest) first.
    level_boxes : boxes of each level; level 0 is the domain.
    step : time step of the finest level and of the coupling.
    steps : coupling steps of the run.
    energies_every, output_every : coupling steps between energies and between outputs. There are
        energies and output at the last step too; see `is_output`.
    write_nodes : whether the continuum writes its nodes too.
    md : None in a run of the continuum only.
    continuum : also in a run of MD only, where its material gives density and stiffness.
    coupling : None in a run of one side.
    checkpoint : None: no checkpoints.
    record : whether the coupler keeps the frames of both sides; never in a run of one side.
    """

    name: str
    units: Literal["lj", "metal", "real", "si"]
    dim: int
    domain: Domain
    level_cells: tuple[float, ...]
    level_boxes: tuple[tuple[Box, ...], ...]
    step: float
    steps: int
    energies_every: int
    output_every: int
    write_nodes: bool
    md: MdPlan | None
    continuum: ContinuumPlan
    coupling: CouplingPlan | None
    checkpoint: CheckpointPlan | None
    record: bool
    only: Role | None
    boundary: Boundary
    initial: Initial

    @property
    def roles(self) -> tuple[Role, ...]:
        """Roles that take part."""
        return (self.only,) if self.only else ("md", "continuum")

    def is_output(self, step: int) -> bool:
        """Whether both sides write their output at a coupling step: each interval, and the end."""
        return step % self.output_every == 0 or step == self.steps

    def renews(self, step: int) -> bool:
        """Whether both sides renew their state at a coupling step.

        To renew a state is to compute from what a checkpoint holds all that it does not hold, such
        as neighbour lists. It changes results by round-off. It is done at fixed steps, whether a
        checkpoint is made or not, so results do not depend on when checkpoints are made.
        """
        return self.checkpoint is not None and step > 0 and step % self.checkpoint.every == 0

    @property
    def steps_together(self) -> int:
        """Coupling steps between two times at which all levels stand."""
        return 2 ** (len(self.level_cells) - 1)

    @property
    def finest_cell(self) -> float:
        """Edge of the cells of the finest level: the h of the coupling."""
        return self.level_cells[-1]

    @property
    def atoms(self) -> MdPlan:
        """The atoms of a run that has some.

        Raises
        ------
        ValueError
            The run has no atoms.
        """
        if self.md is None:
            raise ValueError("the run has no atoms")
        return self.md

    @property
    def coupled(self) -> CouplingPlan:
        """The coupling of a run that has both sides.

        Raises
        ------
        ValueError
            The run has one side only.
        """
        if self.coupling is None:
            raise ValueError("the run has one side only")
        return self.coupling

    def ranks(self, role: Role) -> int:
        """MPI ranks of a role."""
        return self.atoms.ranks if role == "md" else self.continuum.ranks

    def stiffness(self) -> Floats:
        """Stiffness of the continuum at small strains (pressure units), in Voigt order."""
        return materials.stiffness(self.continuum.material, self.dim)

    def face_parts(self) -> list[FacePart]:
        """Parts of the faces that have a condition other than free."""
        return face_parts(self.boundary, self.domain.box, self.stiffness())

    def wave_speed(self, kind: WaveKind) -> float:
        """Speed of plane waves in the continuum (length / time); see `material.wave_speed`."""
        return materials.wave_speed(self.continuum.material, self.units, self.dim, kind)

    def has_crystal_modes(self, packet: Packet) -> bool:
        """Whether a packet is a sum of waves whose speed and motion depend on their direction."""
        return packet.tilt != 0.0 and isinstance(self.continuum.material, materials.Anisotropic)

    def squared_speeds(self) -> Floats:
        """Stiffness over density (length^2 / time^2), in Voigt order."""
        stiffness, density = self.stiffness(), self.continuum.material.density
        return UNITS[self.units].stress_to_mechanical(1.0) / density * stiffness

    def packet_speed(self, packet: Packet) -> float:
        """Speed of a packet along its direction of travel, if all its waves have the same."""
        if packet.tilt != 0.0:  # the body is isotropic
            return self.wave_speed(packet.polarization)
        moved = packet.component(self.dim)
        material = self.continuum.material
        return materials.axial_wave_speed(material, self.units, self.dim, packet.axis, moved)

    def thermal_energy(self) -> float | None:
        """Boltzmann's constant times the continuum's temperature (mechanical units), or None."""
        return materials.thermal_energy(self.continuum.temperature, self.units)

    def background_grid(self) -> BackgroundGrid:
        """Make the grid that both sides share, at the finest cell."""
        return levels.background_grid(self.domain, self.finest_cell)

    def digest(self) -> str:
        """SHA-256 of the file that `write_plan` writes; all services must hold the same."""
        return hashlib.sha256(_text(self)).hexdigest()

    def state_digest(self) -> str:
        """Digest of the part of the plan on which a saved state depends.

        A run may go on to a later end, with other intervals of output, on other ranks, or recorded
        or not.
        """
        replace = msgspec.structs.replace
        md = self.md and replace(self.md, ranks=1, patches=())
        continuum = replace(self.continuum, ranks=1, patches=None, threads=1)
        free = {"name": "", "steps": 0, "energies_every": 0, "output_every": 0, "record": False}
        return replace(self, md=md, continuum=continuum, checkpoint=None, **free).digest()


def make_plan(case: Case) -> Plan:
    """Make every choice that a case leaves open.

    Parameters
    ----------
    case : Case
        Checked, with all that LAMMPS measures filled in (`resolve`).

    Raises
    ------
    ValueError
        The material, or the planes of a run by the force scheme, have not been measured.
    """
    return Plan(
        name=case.name,
        units=case.units,
        dim=case.dim,
        domain=case.domain,
        level_cells=levels.cells(case),
        level_boxes=levels.boxes(case),
        step=times.step(case),
        steps=times.steps(case),
        energies_every=times.energies_every(case),
        output_every=times.output_every(case),
        write_nodes=case.output.nodes,
        md=None if case.only == "continuum" else _md(case),
        continuum=_continuum(case),
        coupling=_coupling(case) if case.only is None else None,
        checkpoint=_checkpoint(case),
        record=case.record and case.only is None,
        only=case.only,
        boundary=case.boundary,
        initial=case.initial,
    )


def _checkpoint(case: Case) -> CheckpointPlan | None:
    wanted = case.checkpoint
    if wanted is None:
        return None
    every = times.renewal_every(case)
    return CheckpointPlan(
        every=every,
        seconds=60.0 * wanted.minutes if wanted.steps is None else None,
        keep=wanted.keep,
    )


def _md(case: Case) -> MdPlan:
    md = case.atoms
    return MdPlan(
        backend=md.backend,
        input=md.input,
        after=md.after,
        files=md.files,
        variables=script_variables(case),
        regions=regions.md_regions(case),
        region=regions.md_region(case),
        cutoff=md.cutoff,
        minimize=md.minimize,
        ranks=md.ranks,
        patches=regions.md_patches(case),
        timestep=times.md_timestep(case),
        steps=times.md_steps(case),
    )


def _continuum(case: Case) -> ContinuumPlan:
    continuum = case.continuum
    return ContinuumPlan(
        backend=continuum.backend,
        mesh=continuum.mesh,
        command=continuum.command,
        material=material(case),
        temperature=continuum.temperature,
        points_per_axis=case.grid.points_per_axis,
        interpolation=continuum.interpolation,
        integrator=choices.integrator(case),
        configuration=choices.configuration(case),
        dispersion=choices.dispersion(case),
        flip=continuum.flip,
        xpic_order=continuum.xpic.order,
        xpic_every=choices.xpic_every(case),
        damping=continuum.damping,
        body_force=continuum.body_force,
        cracks=continuum.cracks,
        ranks=continuum.ranks,
        patches=None if continuum.patches == "auto" else continuum.patches,
        threads=continuum.threads,
    )


def _coupling(case: Case) -> CouplingPlan:
    return CouplingPlan(
        scheme=case.coupling.scheme,
        zones=zones(case),
        filter_rate=choices.filter_rate(case),
        crystal=case.coupling.crystal,
        interfaces=interfaces_of(case) if choices.is_coupled_at_planes(case) else (),
        sites=case.coupling.sites,
        absorber=choices.absorber(case),
        on_defect=case.coupling.on_defect,
    )


def write_plan(plan: Plan, path: Path) -> None:
    """Write a plan as YAML."""
    write_at_once(path, _text(plan))


def _text(plan: Plan) -> bytes:
    return msgspec.yaml.encode(plan, order="sorted")


def load_plan(path: Path) -> Plan:
    """Read the plan of a run folder.

    Raises
    ------
    InputError
        The file is missing, or is no plan of this version.
    """
    try:
        return msgspec.yaml.decode(path.read_bytes(), type=Plan, strict=True)
    except OSError as error:
        reason, hint = str(error.strerror), "start the run again: gimpmd run writes the plan"
    except msgspec.DecodeError as error:  # ValidationError too
        reason, hint = str(error), "a plan is written by gimpmd; change the case and run it again"
    raise InputError(str(path), [Problem("plan", None, reason, hint)])
