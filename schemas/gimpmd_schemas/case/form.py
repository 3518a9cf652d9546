"""The case file: one YAML file with which a run can be repeated.

The structs below are the schema; ``case.schema.json`` is generated from them. Lengths, times,
masses, energies and pressures have the units of the LAMMPS unit style that the case names.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from gimpmd_schemas.case.base import PerAxis, Region, Strict, Timed, Vector
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.materials import Material, MeasuredByMd
from gimpmd_schemas.grid.zones import Box

Role = Literal["md", "continuum"]
"""The two sides of a run."""

FACES = ("left", "right", "bottom", "top", "back", "front")
"""Names of the faces of the domain: lower and upper x, y and, in three dimensions, z."""


class Domain(Strict, frozen=True):
    """The body: a rectangle or, in three dimensions, a block.

    Attributes
    ----------
    box : ``[[xlo, xhi], [ylo, yhi]]``, with ``[zlo, zhi]`` in three dimensions.
    periodic : for each axis, whether the body is periodic; left out: along no axis.
    """

    box: Region
    periodic: Annotated[tuple[bool, ...], Meta(max_length=3)] = ()

    def __post_init__(self) -> None:
        if not self.periodic:
            msgspec.structs.force_setattr(self, "periodic", (False,) * len(self.box))


class Level(Strict, frozen=True):
    """One more refinement of the grid: boxes with half the cell of the next coarser level.

    Attributes
    ----------
    boxes : each inside a box of the next coarser level, with faces on its node lines.
    """

    boxes: tuple[Region, ...]


class Grid(Strict, frozen=True):
    """The background grid: cell size, refinement, and material points in a cell.

    Attributes
    ----------
    cell : edge of the coarsest cells.
    points_per_axis : material points in a cell along each axis.
    levels : successive refinements by two; level 0 is the whole domain.
    """

    cell: float
    points_per_axis: int = 2
    levels: tuple[Level, ...] = ()


class Time(Strict, frozen=True):
    """End time, MD time step and temporal factor N (paper Eq. 17), or the step of the continuum.

    Attributes
    ----------
    end : end time.
    md_timestep : time step of the atoms; required with ``md``.
    md_steps : N, the MD steps per continuum step; ``auto`` takes Eq. 17 with the paper's c = 0.1.
    step : in a case without atoms, the step of the finest level; ``auto`` takes the CFL number 0.4.
    """

    end: float
    md_timestep: float | None = None
    md_steps: int | Literal["auto"] = "auto"
    step: float | Literal["auto"] = "auto"


class Md(Strict, frozen=True):
    """The atomistic side: where it is, and the LAMMPS input.

    Attributes
    ----------
    region : box of the MD region, inside the domain.
    regions : in place of ``region``, boxes of several MD regions that do not touch each other.
    input : LAMMPS script that makes the atoms and the potential, in the folder of the case file.
    files : further files that the script reads (potential tables, included scripts).
    after : optional script, read after gimpmd has defined its groups; for thermostats.
    variables : passed to the scripts as LAMMPS variables.
    cutoff : range of the potential; if given, it must agree with LAMMPS.
    minimize : relax the atoms before the run (otherwise cut surfaces vibrate).
    ranks, patches : MPI ranks, and patches along each axis; their product is the number of ranks.
    backend : name under which the MD code is registered.
    """

    input: str
    region: Region | None = None
    regions: tuple[Region, ...] = ()
    files: tuple[str, ...] = ()
    after: str | None = None
    variables: dict[str, float | str] = msgspec.field(default_factory=dict)
    cutoff: float | None = None
    minimize: bool = True
    ranks: int = 1
    patches: Annotated[tuple[int, ...], PerAxis] | Literal["auto"] = "auto"
    backend: str = "lammps"

    def boxes(self) -> dict[str, Box]:
        """Boxes of the MD regions, by their keys in the case file."""
        if self.region is not None:
            return {"md.region": self.region}
        return {f"md.regions[{k}]": box for k, box in enumerate(self.regions)}


class Xpic(Strict, frozen=True):
    """The XPIC filter, which removes velocities that the grid does not see.

    Attributes
    ----------
    order : order m of the filter.
    every : steps between two uses; 0: never. ``auto`` is 20, and 0 in the reference configuration.
    """

    order: int = 5
    every: int | Literal["auto"] = "auto"


class Crack(Strict, frozen=True, rename={"start": "from", "end": "to"}):
    """A straight or plane crack in a run of the continuum only: two velocity fields.

    Attributes
    ----------
    from, to : the two ends (``start`` and ``end`` in Python); the crack tip is at ``to``.
    along : in three dimensions the crack is the parallelogram from, to, to + along, from + along.
    contact : ``none``: the faces are free of traction and may overlap; or ``frictional``.
    friction : Coulomb's coefficient of frictional contact.
    j_radius : radius of the domain of the J-integral around ``to``; null: no J-integral.
    """

    start: Vector
    end: Vector
    along: Vector | None = None
    contact: Literal["none", "frictional"] = "none"
    friction: float = 0.0
    j_radius: float | None = None

    def corners(self) -> tuple[tuple[float, ...], ...]:
        """Ends of the line, or corners of the parallelogram in order."""
        if self.along is None:
            return self.start, self.end
        far, near = (
            tuple(x + dx for x, dx in zip(end, self.along, strict=True))
            for end in (self.end, self.start)
        )
        return self.start, self.end, far, near


class Damping(Strict, frozen=True):
    """Damping of the continuum in a region.

    Attributes
    ----------
    box : where; null: everywhere.
    rate : the velocity decays by this rate (1 / time).
    flip : share of FLIP there, instead of the continuum's own.
    """

    box: Region | None = None
    rate: float = 0.0
    flip: float | None = None


class BodyForce(Timed, frozen=True, kw_only=True):
    """An acceleration of the whole continuum.

    Attributes
    ----------
    acceleration : its components (length / time^2).
    ramp : time over which it grows linearly from zero.
    history : in place of a ramp, ``[[time, factor], ...]``: linear between the times, constant
        before and after.
    """

    acceleration: Vector


class Continuum(Strict, frozen=True):
    """The continuum side: material and numerical method.

    Attributes
    ----------
    temperature : temperature of the crystal (units of the style), whose thermal stress expands the
        body; null: no stress at rest.
    integrator : ``auto`` is USAVG for the continuum only. It is MUSL in a coupled run, because the
        velocities of MUSL belong to half steps as the averages over MD steps do, and with corrected
        dispersion.
    configuration : position of the points on the background grid: they move over it
        (``current``), or stay at their reference positions (``reference``, total Lagrangian). This
        holds for the atoms near the interface too. ``auto`` is ``reference`` in a run coupled by
        the force or the velocity scheme, and ``current`` otherwise.
    dispersion : ``corrected``: wave speeds are exact to one more order in cell over wavelength, in
        the reference configuration; or ``lumped``. ``auto`` corrects in a run coupled by the force
        scheme.
    flip : fraction of FLIP in the update of velocities; the rest is PIC.
    damping : damped regions; where they overlap, the last one counts.
    ranks, patches : MPI ranks, and patches of every level along each axis; their product is the
        number of ranks.
    threads : threads of each rank of the GIMP service; ``auto`` shares all cores.
    backend : name under which the continuum code is registered.
    mesh : file with the elements around the atoms, beside the case, for finite elements; null: one
        element for each cell of the grid.
    command : program of a service in any language, in place of a backend, with its first words. A
        name with a slash is a path from the folder of the case; others are looked for on the PATH.
    """

    material: Material | MeasuredByMd
    temperature: float | None = None
    interpolation: Literal["linear", "ugimp", "cpgimp", "bspline"] = "ugimp"
    integrator: Literal["auto", "usavg", "musl", "usf", "usl"] = "auto"
    configuration: Literal["auto", "current", "reference"] = "auto"
    dispersion: Literal["auto", "lumped", "corrected"] = "auto"
    flip: float = 1.0
    xpic: Xpic = Xpic()
    damping: tuple[Damping, ...] = ()
    body_force: BodyForce | None = None
    cracks: tuple[Crack, ...] = ()
    ranks: int = 1
    patches: Annotated[tuple[int, ...], PerAxis] | Literal["auto"] = "auto"
    threads: int | Literal["auto"] = "auto"
    backend: str = "gimp"
    mesh: str | None = None
    command: tuple[str, ...] = ()


SchemeName = Literal["force", "sites", "velocity", "paper"]

AT_PLANES: tuple[SchemeName, ...] = ("force", "sites")
"""Schemes with planes, beyond which ghost atoms follow the nodes and return their forces."""


class Crystal(Strict, frozen=True):
    """A lattice with one atom in its primitive cell and a pair potential; found by LAMMPS.

    Attributes
    ----------
    vectors : primitive vectors of the lattice at rest (length), one for each axis.
    origin : position of one of its sites (length).
    bonds : vectors to the neighbours within the cutoff, one of each pair of opposite ones.
    energy : for each bond the coefficients ``c_1, c_2, ...`` of its energy relative to rest, the
        polynomial ``sum_k c_k (s - 1)^k`` in ``s = (length / length at rest)^2`` (energy units).
    stretch_limit : ``|s - 1|`` up to which the polynomials hold.
    """

    vectors: Annotated[tuple[Vector, ...], PerAxis]
    origin: Vector
    bonds: tuple[Vector, ...]
    energy: tuple[tuple[float, ...], ...]
    stretch_limit: float


class Planes(Strict, frozen=True):
    """Planes that separate free atoms from the continuum, by face; null: no interface there.

    Attributes
    ----------
    left, right, bottom, top, back, front : coordinate of the plane (length).
    """

    left: float | None = None
    right: float | None = None
    bottom: float | None = None
    top: float | None = None
    back: float | None = None
    front: float | None = None

    def limits(self, dim: int) -> Box:
        """Lower and upper plane along each axis, infinite where there is none."""
        ends = ((self.left, self.right), (self.bottom, self.top), (self.back, self.front))
        return tuple(
            (-math.inf if low is None else low, math.inf if high is None else high)
            for low, high in ends[:dim]
        )


class Sites(Strict, frozen=True):
    """What LAMMPS measures of the crystal near the planes, for the scheme ``sites``.

    Numbers are little-endian floats of 8 bytes, in C order. "Each strain" is the crystal at rest,
    and then the derivative in each component of strain, in Voigt order with engineering shear.

    Attributes
    ----------
    vectors : primitive vectors of the crystal at rest (length), one for each axis.
    origin : position of one of its atoms (length).
    basis : places of the atoms of a primitive cell relative to it (length).
    shift : inner shift of each of these atoms, per unit of each component of strain (length); it
        comes in addition to the uniform displacement gradient.
    period : shortest translation of the crystal along each axis (length).
    layers : distance of its layers of atoms along each axis (length); 0 where they are uneven.
    second : the second planes, in the order of the MD regions.
    nodes : ids of the nodes that ghost atoms move, ascending.
    force : for each strain, forces of the ghost atoms on these nodes (mechanical units).
    stress : for each strain, the Piola stress of the crystal (mechanical units).
    surface : forces that the surfaces of the crystal exert at rest on these nodes, at faces of the
        body where planes end (mechanical units); empty: there are none.
    """

    vectors: Annotated[tuple[Vector, ...], PerAxis]
    origin: Vector
    basis: tuple[Vector, ...]
    shift: bytes
    period: Vector
    layers: Vector
    second: tuple[Planes, ...]
    nodes: tuple[int, ...]
    force: bytes
    stress: bytes
    surface: bytes = b""


class ZoneWidths(Strict, frozen=True):
    """Widths of the zones (length units); null: the default.

    The defaults refer to the finest level: one cell for the outer zone, no incommunicado zone,
    seven layers of points for the inner zone and two cells for the filter; in the scheme ``paper``
    four layers for the incommunicado and the inner zone each. The outer zone must be at least as
    wide as the cutoff of the potential.
    """

    outer: float | None = None
    incommunicado: float | None = None
    inner: float | None = None
    filter: float | None = None


class Absorber(Strict, frozen=True):
    """Damping of waves that are too short for the grid, in a band of free atoms along the planes.

    Attributes
    ----------
    rate : decay rate of such motion next to the planes (1 / time); null: 1.55 c / h, where c is the
        speed of the slowest shear wave along the normal of the planes and h the finest cell.
    width : width of the band (length); null: 4.5 cells of the finest level.
    temperature : temperature that a matching random force maintains (units of the style).
    seed : seed of the random force.
    """

    rate: float | None = None
    width: float | None = None
    temperature: float = 0.0
    seed: int = 1


class Coupling(Strict, frozen=True):
    """How the two sides are coupled.

    Attributes
    ----------
    scheme : ``force``: ghost atoms follow the grid and return their forces to it (scheme F);
        ``sites``: the same for many-body potentials, whose energies are sums over sites (scheme
        FS);
        ``velocity``: exchange of velocities in three zones (scheme S); ``paper``: the same as
        published by Ma et al., which is unstable without damping.
    zones : widths of the zones of the schemes ``velocity`` and ``paper``.
    filter_rate : strength of the zone filter per unit time, beta = rate * dt; null: half the
        longitudinal wave speed over the finest cell, c_l / 2 h. Much larger rates are unstable.
    crystal, planes : what LAMMPS finds about the atoms near the interface, for the force scheme;
        with ``md.regions`` a list of planes with one entry for each region.
    sites : what LAMMPS measures at the planes, for the scheme ``sites``.
    absorber : absorber of short waves at the interface, in the schemes with planes; null: none.
    on_defect : what happens when a monitor finds that the results are not reliable, for example
        because a defect has reached the planes: ``warn`` says so once, ``stop`` ends the run too,
        with exit code 4.
    """

    scheme: SchemeName = "force"
    zones: ZoneWidths = ZoneWidths()
    filter_rate: float | None = None
    crystal: Crystal | None = None
    planes: Planes | tuple[Planes, ...] | None = None
    sites: Sites | None = None
    absorber: Absorber | None = None
    on_defect: Literal["warn", "stop"] = "warn"

    def each_planes(self) -> dict[str, Planes]:
        """Planes of each MD region by their keys in the case file; empty if they are not known."""
        if isinstance(self.planes, Planes):
            return {"coupling.planes": self.planes}
        return {f"coupling.planes[{k}]": planes for k, planes in enumerate(self.planes or ())}


class Boundary(Strict, frozen=True):
    """Conditions on the faces of the domain; a face without condition is free.

    A face has one condition, or a list of parts with a condition each.

    Attributes
    ----------
    back, front : lower and upper z, in three dimensions.
    """

    left: Face | tuple[Face, ...] = Face()
    right: Face | tuple[Face, ...] = Face()
    bottom: Face | tuple[Face, ...] = Face()
    top: Face | tuple[Face, ...] = Face()
    back: Face | tuple[Face, ...] = Face()
    front: Face | tuple[Face, ...] = Face()

    def parts(self, axis: int, side: int) -> dict[str, Face]:
        """Conditions on the lower (``side`` 0) or upper (1) face of an axis, by their keys."""
        name = FACES[2 * axis + side]
        given: Face | tuple[Face, ...] = getattr(self, name)
        if isinstance(given, Face):
            return {f"boundary.{name}": given}
        return {f"boundary.{name}[{k}]": part for k, part in enumerate(given)}


class Packet(Strict, frozen=True):
    """A plane wave packet at the start: a cosine under a Gaussian envelope.

    Attributes
    ----------
    center : position of the middle along ``axis``.
    wavelength : of the carrier.
    cycles : full width at half maximum of the envelope, in wavelengths.
    strain : amplitude of the strain.
    axis : 0 for x, 1 for y, 2 for z; the direction of travel.
    direction : +1 or -1 along the axis.
    polarization : ``P`` (along the axis) or ``S`` (along the next axis, in cyclic order).
    tilt : angle (degrees) from the axis to the wave vector, towards the next axis. The envelope
        depends on the position along the axis only. In an anisotropic body ``P`` is the faster and
        ``S`` the slower mode that moves in the plane of both axes; neither need travel along its
        wave vector.
    """

    center: float
    wavelength: float
    strain: float
    cycles: float = 2.0
    axis: Literal[0, 1, 2] = 0
    direction: Literal[1, -1] = 1
    polarization: Literal["P", "S"] = "P"
    tilt: float = 0.0

    def travel(self, dim: int) -> tuple[float, ...]:
        """Unit vector of the direction of travel."""
        angle, n = math.radians(self.tilt), [0.0] * dim
        n[self.axis] = self.direction * math.cos(angle)
        n[(self.axis + 1) % dim] = math.sin(angle)
        return tuple(n)

    def component(self, dim: int) -> int:
        """Axis along which the body moves."""
        return self.axis if self.polarization == "P" else (self.axis + 1) % dim


class VelocityField(Strict, frozen=True):
    """A velocity at the start, uniform or linear in space.

    Attributes
    ----------
    velocity : components at the centre.
    box : where, half-open (``lo <= x < hi``); null: everywhere.
    gradient : matrix G of ``velocity + G (x - center)``; null: uniform.
    center : where the velocity is ``velocity``; null: the origin.
    """

    velocity: Vector
    box: Region | None = None
    gradient: Annotated[tuple[Vector, ...], PerAxis] | None = None
    center: Vector | None = None


class Stretch(Strict, frozen=True):
    """A uniform displacement gradient at the start.

    Attributes
    ----------
    gradient : matrix G of the displacement ``G (X - center)``.
    center : where the displacement is zero; null: the origin.
    """

    gradient: Annotated[tuple[Vector, ...], PerAxis]
    center: Vector | None = None


class Initial(Strict, frozen=True):
    """State at the start; all entries are added to the state at rest."""

    packets: tuple[Packet, ...] = ()
    velocities: tuple[VelocityField, ...] = ()
    stretch: Stretch | None = None


class Output(Strict, frozen=True):
    """What a run writes, and when.

    Attributes
    ----------
    interval : time between outputs of fields and atoms, and between figures.
    energy_interval : time between energies in ``run.h5``; null: a two-hundredth of the run. A step
        at which LAMMPS computes energies takes as long as two or three others.
    nodes : whether the fields on the nodes are written too.
    figures : fields that are drawn at the end of the run.
    """

    interval: float
    energy_interval: float | None = None
    nodes: bool = False
    figures: tuple[str, ...] = ("sigma_yy",)


class Checkpoint(Strict, frozen=True):
    """When a run saves its state, from which `gimpmd resume` goes on.

    Attributes
    ----------
    minutes : wall time between checkpoints.
    steps : coupling steps between checkpoints, in place of ``minutes``.
    keep : how many checkpoints stay on disk; older ones are removed.
    """

    minutes: float = 10.0
    steps: int | None = None
    keep: int = 2


class Case(Strict, frozen=True, kw_only=True):
    """A whole run.

    Attributes
    ----------
    gimpmd : version of the case format.
    name : name of the run, and of its folder.
    units : LAMMPS unit style.
    md : the atoms; may be left out for a run of the continuum only.
    checkpoint : null: no checkpoints.
    record : whether the frames of both sides are kept, for `gimpmd replay`.
    only : run only this side, over the whole domain (``--only``); null: both.
    """

    gimpmd: Literal[1]
    name: str
    units: Literal["lj", "metal", "real", "si"]
    domain: Domain
    grid: Grid
    time: Time
    md: Md | None = None
    continuum: Continuum
    output: Output
    coupling: Coupling = Coupling()
    boundary: Boundary = Boundary()
    initial: Initial = Initial()
    checkpoint: Checkpoint | None = Checkpoint()
    record: bool = False
    only: Role | None = None

    def roles(self) -> tuple[Role, ...]:
        """Roles that take part: ``md``, ``continuum`` or both."""
        return (self.only,) if self.only else ("md", "continuum")

    @property
    def dim(self) -> int:
        """Number of dimensions, 2 or 3."""
        return len(self.domain.box)

    @property
    def atoms(self) -> Md:
        """The atomistic side.

        Raises
        ------
        ValueError
            The case has none.
        """
        if self.md is None:
            raise ValueError("the case has no atoms")
        return self.md

    def ranks(self, role: Role) -> int:
        """MPI ranks of a role."""
        return self.atoms.ranks if role == "md" else self.continuum.ranks
