"""The case file: one YAML file that describes a run and is enough to repeat it.

The structs below are the schema; ``case.schema.json`` is generated from them. Lengths, times,
masses, energies and pressures are in the LAMMPS unit style that the case names.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import msgspec

from gimpmd_schemas.grid import BackgroundGrid
from gimpmd_schemas.units import UNITS
from gimpmd_schemas.zones import Box, Zones

Pair = tuple[float, float]
FACES = ("left", "right", "bottom", "top")
"""Names of the domain's faces: lower and upper x, lower and upper y."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of the case file: immutable, and no key passes unseen."""


class Domain(_Strict, frozen=True):
    """The body: a rectangle.

    Attributes
    ----------
    box : ``[[xlo, xhi], [ylo, yhi]]``
    periodic : along which axes the body repeats.
    """

    box: tuple[Pair, Pair]
    periodic: tuple[bool, bool] = (False, False)


class Grid(_Strict, frozen=True):
    """The background grid: cell size, and material points per cell in each direction."""

    cell: float
    points_per_cell: int = 2


class Time(_Strict, frozen=True):
    """End time, MD time step, and the temporal factor N (paper Eq. 17).

    Attributes
    ----------
    md_steps : N, the MD steps per continuum step; ``auto`` takes Eq. 17 with the paper's c = 0.1.
    """

    end: float
    md_timestep: float
    md_steps: int | Literal["auto"] = "auto"


class Md(_Strict, frozen=True):
    """The atomistic side: where it lies and the user's own LAMMPS input.

    Attributes
    ----------
    region : box of the MD region, inside the domain.
    input : LAMMPS script that makes the atoms and the potential, beside the case file.
    files : further files that the script reads (potential tables, included scripts).
    after : optional script, read after gimpmd has defined its groups (thermostats go here).
    variables : handed to the scripts as LAMMPS variables.
    cutoff : range of the potential; checked against LAMMPS's own when given.
    minimize : relax the MD region before the run (cut surfaces ring otherwise).
    ranks, patches : MPI ranks, and how they share the region; patches multiply to ranks.
    backend : which implementation runs.
    """

    region: tuple[Pair, Pair]
    input: str
    files: tuple[str, ...] = ()
    after: str | None = None
    variables: dict[str, float | str] = {}
    cutoff: float | None = None
    minimize: bool = True
    ranks: int = 1
    patches: tuple[int, int] | Literal["auto"] = "auto"
    backend: Literal["lammps"] = "lammps"


class Elastic(_Strict, frozen=True, tag_field="from", tag="case"):
    """Isotropic linear elasticity with moduli given in the case.

    Attributes
    ----------
    density : mass per area.
    lame, shear : Lame's lambda and the shear modulus mu of plane strain (pressure units), so
        that ``C11 = lambda + 2 mu``.
    """

    density: float
    lame: float
    shear: float


class MeasuredByMd(_Strict, frozen=True, tag_field="from", tag="md"):
    """Density and moduli measured by LAMMPS on a periodic cell of the same crystal.

    Attributes
    ----------
    cell : LAMMPS script that makes the periodic cell, beside the case file.
    """

    cell: str


class Xpic(_Strict, frozen=True):
    """The XPIC filter of FLIP's null space: order m, applied every so many steps (0: never)."""

    order: int = 5
    every: int = 20


class Crack(_Strict, frozen=True, rename={"start": "from", "end": "to"}):
    """A traction-free straight crack in a run of the continuum alone."""

    start: Pair
    end: Pair


class Continuum(_Strict, frozen=True):
    """The continuum side: material, and how GIMP solves it.

    Attributes
    ----------
    integrator : ``auto`` takes USAVG for the continuum alone and MUSL, whose velocities stand at
        half steps as the atoms' window averages do, in the velocity-exchange scheme.
    threads : of the GIMP service; ``auto`` takes all cores.
    """

    material: Elastic | MeasuredByMd
    interpolation: Literal["ugimp", "cpgimp"] = "ugimp"
    integrator: Literal["auto", "usavg", "musl"] = "auto"
    xpic: Xpic = Xpic()
    cracks: tuple[Crack, ...] = ()
    ranks: int = 1
    threads: int | Literal["auto"] = "auto"
    backend: Literal["gimp"] = "gimp"


class ZoneWidths(_Strict, frozen=True):
    """Widths of the zones (length units); what is left out gets a sound default.

    Defaults: outer one cell, incommunicado one layer of points, inner six layers of points,
    filter two cells. The outer zone must be at least as wide as the potential's cutoff.
    """

    outer: float | None = None
    incommunicado: float | None = None
    inner: float | None = None
    filter: float | None = None


class Coupling(_Strict, frozen=True):
    """How the two sides are tied together.

    Attributes
    ----------
    scheme : ``velocity``, the exchange of velocities in three zones (scheme S).
    filter_rate : strength of the zone filter per unit time, beta = rate * dt; left out, it is
        the longitudinal wave speed over the cell, c_l / h.
    """

    scheme: Literal["velocity"] = "velocity"
    zones: ZoneWidths = ZoneWidths()
    filter_rate: float | None = None


class Face(_Strict, frozen=True):
    """Condition on one face of the domain.

    Attributes
    ----------
    condition : ``free``, ``traction`` (value: force per length, global components, pressure
        units), ``velocity`` (value: components, ``null`` leaves one free) or ``symmetry``.
    value : components of the traction or velocity.
    ramp : time over which the value grows linearly from zero.
    """

    condition: Literal["free", "traction", "velocity", "symmetry"] = "free"
    value: tuple[float | None, float | None] = (None, None)
    ramp: float = 0.0

    def factor(self, time: float) -> float:
        """Fraction of the value that acts at ``time``."""
        return 1.0 if self.ramp <= 0.0 else min(max(time / self.ramp, 0.0), 1.0)


class Boundary(_Strict, frozen=True):
    """Conditions on the four faces of the domain; free where nothing is said."""

    left: Face = Face()
    right: Face = Face()
    bottom: Face = Face()
    top: Face = Face()

    def face(self, axis: int, side: int) -> Face:
        """Condition on the lower (``side`` 0) or upper (1) face of an axis."""
        faces = ((self.left, self.right), (self.bottom, self.top))
        return faces[axis][side]


class Packet(_Strict, frozen=True):
    """A plane wave packet at the start: a cosine under a Gaussian envelope.

    Attributes
    ----------
    center : position of the middle along ``axis``.
    wavelength : of the carrier.
    cycles : full width at half maximum of the envelope, in wavelengths.
    strain : amplitude of the strain.
    axis : 0 for x, 1 for y; the direction of travel.
    direction : +1 or -1 along the axis.
    polarization : ``P`` (along the axis) or ``S`` (across it).
    """

    center: float
    wavelength: float
    strain: float
    cycles: float = 2.0
    axis: Literal[0, 1] = 0
    direction: Literal[1, -1] = 1
    polarization: Literal["P", "S"] = "P"


class Initial(_Strict, frozen=True):
    """State at the start, on top of rest."""

    packets: tuple[Packet, ...] = ()


class Output(_Strict, frozen=True):
    """What a run writes and when: fields, dumps and figures every ``interval`` of time."""

    interval: float
    nodes: bool = False


class Case(_Strict, frozen=True):
    """A whole run.

    Attributes
    ----------
    gimpmd : version of the case format.
    only : set by ``--only``: run one side alone over the whole domain.
    """

    gimpmd: Literal[1]
    name: str
    units: Literal["lj", "metal", "real", "si"]
    domain: Domain
    grid: Grid
    time: Time
    md: Md
    continuum: Continuum
    output: Output
    coupling: Coupling = Coupling()
    boundary: Boundary = Boundary()
    initial: Initial = Initial()
    only: Literal["md", "continuum"] | None = None

    def roles(self) -> tuple[str, ...]:
        """Roles that take part: ``md``, ``continuum`` or both."""
        return (self.only,) if self.only else ("md", "continuum")

    def ranks(self, role: str) -> int:
        """MPI ranks of a role."""
        return self.md.ranks if role == "md" else self.continuum.ranks

    def scripts(self) -> list[tuple[str, str]]:
        """Key and name of every file that LAMMPS reads for this run; empty if it reads none."""
        material, named = self.continuum.material, []
        if self.only != "continuum":
            named.append(("md.input", self.md.input))
            if self.md.after is not None:
                named.append(("md.after", self.md.after))
        if isinstance(material, MeasuredByMd):
            named.append(("continuum.material.cell", material.cell))
        if named:  # a script, which may read these
            named += [(f"md.files[{i}]", name) for i, name in enumerate(self.md.files)]
        return named

    def md_region(self) -> Box:
        """Box of the atoms: the MD region, or the whole domain of a run of MD alone."""
        return self.domain.box if self.only == "md" else self.md.region

    def md_patches(self) -> tuple[int, int]:
        """Patches along x and y; ``auto`` makes them as square as the ranks allow."""
        if self.md.patches != "auto":
            return self.md.patches
        (x0, x1), (y0, y1) = self.md_region()
        n = self.md.ranks
        layouts = [(p, n // p) for p in range(1, n + 1) if n % p == 0]
        return min(layouts, key=lambda pq: (abs((x1 - x0) / pq[0] - (y1 - y0) / pq[1]), pq))

    def md_steps(self) -> int:
        """Temporal factor N (paper Eq. 17); needs a resolved material when it is ``auto``."""
        if self.time.md_steps != "auto":
            return self.time.md_steps
        step = 0.1 * self.grid.cell / self.wave_speed("bar")
        return max(1, round(step / self.time.md_timestep))

    def step(self) -> float:
        """Time step of the continuum and of the coupling, ``N dt_MD``."""
        return self.md_steps() * self.time.md_timestep

    def steps(self) -> int:
        """Coupling steps from start to end; the last one reaches or passes the end time."""
        ratio = self.time.end / self.step()
        return max(1, int(-(-ratio // 1)) if abs(ratio - round(ratio)) > 1e-9 else round(ratio))

    def output_every(self) -> int:
        """Coupling steps between outputs."""
        return max(1, round(self.output.interval / self.step()))

    def background_grid(self) -> BackgroundGrid:
        """Make the grid that both sides share."""
        (x0, x1), (y0, y1) = self.domain.box
        h = self.grid.cell
        return BackgroundGrid(
            (x0, y0), h, (round((x1 - x0) / h), round((y1 - y0) / h)), self.domain.periodic
        )

    def zones(self) -> Zones:
        """Zones with defaults filled in; a run of one side alone has no interface."""
        h, layer = self.grid.cell, self.grid.cell / self.grid.points_per_cell
        widths = self.coupling.zones
        faces = [[False, False], [False, False]]
        if self.only is None:
            for axis in range(2):
                if not self.domain.periodic[axis]:
                    for side in range(2):
                        gap = abs(self.md.region[axis][side] - self.domain.box[axis][side])
                        faces[axis][side] = gap > 1e-9 * h
        return Zones(
            region=self.md_region(),
            interfaces=((faces[0][0], faces[0][1]), (faces[1][0], faces[1][1])),
            outer=h if widths.outer is None else widths.outer,
            incommunicado=layer if widths.incommunicado is None else widths.incommunicado,
            inner=6.0 * layer if widths.inner is None else widths.inner,
            filter=2.0 * h if widths.filter is None else widths.filter,
        )

    def filter_rate(self) -> float:
        """Strength of the zone filter per unit time, its default filled in."""
        rate = self.coupling.filter_rate
        return self.wave_speed("P") / self.grid.cell if rate is None else rate

    def elastic(self) -> Elastic:
        """Material with its moduli; resolved before any service starts."""
        if not isinstance(self.continuum.material, Elastic):
            raise ValueError("the material has not been measured yet")
        return self.continuum.material

    def wave_speed(self, kind: Literal["P", "S", "bar"]) -> float:
        """Speed of plane waves, or ``sqrt(E / rho)`` of paper Eq. 17 (length / time)."""
        material = self.elastic()
        lame, shear = material.lame, material.shear
        modulus = {
            "P": lame + 2.0 * shear,
            "S": shear,
            "bar": 4.0 * shear * (lame + shear) / (lame + 2.0 * shear),
        }[kind]
        return float((UNITS[self.units].stress_to_mechanical(modulus) / material.density) ** 0.5)

    def digest(self) -> str:
        """SHA-256 of the case in canonical form; all services must hold the same."""
        return hashlib.sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()
