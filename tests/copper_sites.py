"""Crystals by many-body potentials, coupled by the sites scheme in space: cases and scripts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from gimpmd_schemas.case.form import FACES, Case
from tests.measuring import measured

SPEEDS = {"P": 43.6017, "S": 29.2033}
"""Speeds of waves along the axes of copper (angstrom / ps)."""


@dataclass(frozen=True)
class Metal:
    """A crystal with axes along the edges of its cell, and the grid that suits it.

    Attributes
    ----------
    structure : of LAMMPS's ``lattice``.
    constant : lattice constant at zero pressure (angstrom), by ``gimpmd lattice``.
    style, file, element : pair style, potential file of LAMMPS, and element in it.
    periods : lattice constants in a cell of the grid.
    roughness : by how much LAMMPS's C11 at strains of 1e-4, from which corrections are made,
        differs from that at 1e-6, relative.
    orient : further options of LAMMPS's ``lattice``: axes, and atoms of a cell.
    types : of atoms.
    kinds : options of LAMMPS's ``create_atoms``, for atoms that are not of type 1.
    repeats : lattice spacings of LAMMPS along z after which the crystal repeats.
    origin : of the lattice, in lattice constants: half a layer.
    mass : of an atom, if the potential gives none.
    md_steps : MD steps of 2 fs in a coupling step.
    speeds : of waves along the axes (angstrom / ps), for cases with packets.
    cycles : of a packet.
    noise : largest error of the energy at a strain of 1e-5, relative: the energy of that strain is
        1e-10 of the energy of the crystal, whose round-off depends on the potential.
    """

    structure: str
    constant: float
    style: str
    file: str
    element: str
    periods: float
    roughness: float = 0.0
    orient: str = ""
    types: int = 1
    kinds: str = ""
    repeats: int = 1
    origin: float = 0.25
    mass: float | None = None
    md_steps: int = 16
    speeds: Mapping[str, float] = field(default_factory=SPEEDS.copy)
    cycles: float = 2.0
    noise: float = 1e-5

    @property
    def cell(self) -> float:
        """Edge of a cell of the grid (angstrom)."""
        return self.periods * self.constant

    @property
    def place(self) -> str:
        """Origin of the lattice, for LAMMPS."""
        return f"{self.origin} {self.origin} {self.origin}"

    @property
    def potential(self) -> str:
        """Commands of LAMMPS."""
        mass = "" if self.mass is None else f"mass 1 {self.mass}\n"
        return f"{mass}pair_style {self.style}\npair_coeff * * {self.file} {self.element}\n"


COPPER = Metal("fcc", 3.614925065810289, "eam/alloy", "Cu_mishin1.eam.alloy", "Cu", 2.0)
COPPER_110 = replace(COPPER, periods=2.5, orient="orient x 1 1 0 orient y 0 0 1 orient z 1 -1 0")
COPPER_111 = replace(
    COPPER, periods=2.5, orient="orient x 1 -1 0 orient y 1 1 1 orient z -1 -1 2", repeats=3
)
COPPER_FUNCFL = replace(
    COPPER,
    constant=3.6149999757626423,
    style="eam",
    file="Cu_u3.eam",
    element="",
    speeds={"P": 43.2665, "S": 29.2503},
)
COPPER_SNAP = Metal(
    "fcc",
    3.633761648149696,
    "snap",
    "Cu_Zuo_JPCA2020.snapcoeff Cu_Zuo_JPCA2020.snapparam",
    "Cu",
    1.0,
    mass=63.546,
    md_steps=8,
    speeds={"P": 45.0203, "S": 31.2758},
    cycles=1.0,
)
"""Small cells and a short packet, because the potential is slow."""
ALUMINIUM = Metal(
    "fcc",
    4.0816549007845255,
    "eam/alloy",
    "Al_zhou.eam.alloy",
    "Al",
    2.5,
    speeds={"P": 69.4428, "S": 37.1789},
)
ALUMINIUM_JEA = Metal(
    "fcc",
    4.050000068032158,
    "eam/alloy",
    "NiAlH_jea.eam.alloy",
    "Al",
    2.0,
    speeds={"P": 65.0090, "S": 34.2332},
)
"""With a shorter cutoff than ALUMINIUM."""
ALUMINIUM_FS = Metal(
    "fcc",
    4.04525979376056,
    "eam/fs",
    "Al_mm.eam.fs",
    "Al",
    2.0,
    roughness=1.2e-2,
    speeds={"P": 62.6712, "S": 33.6598},
)
IRON = Metal(
    "bcc",
    2.8553248608254136,
    "eam/fs",
    "Fe_mm.eam.fs",
    "Fe",
    3.0,
    roughness=1.3e-3,
    speeds={"P": 55.3389, "S": 38.2044},
)
TUNGSTEN = Metal(
    "bcc",
    3.164849455441857,
    "eam/alloy",
    "W_zhou.eam.alloy",
    "W",
    3.5,
    speeds={"P": 52.0870, "S": 28.8903},
)
TUNGSTEN_FINE = replace(TUNGSTEN, periods=2.5)
"""In smaller cells, so that waves take less time."""
SILICON = Metal(
    "diamond",
    5.430949778405117,
    "sw",
    "Si.sw",
    "Si",
    1.5,
    origin=0.125,
    mass=28.0855,
    md_steps=8,
    speeds={"P": 80.6308, "S": 49.2303},
)
SILICON_110 = replace(
    SILICON, periods=1.5 * 0.5**0.5, orient="orient x 0 0 1 orient y 1 1 0 orient z -1 1 0"
)
SILICON_TERSOFF = replace(
    SILICON,
    constant=5.432114844306426,
    style="tersoff",
    file="SiC.tersoff",
    speeds={"P": 78.2473, "S": 54.4513},
    noise=2e-5,
)
SILICON_SOFT = replace(
    SILICON_TERSOFF,
    constant=5.431230748448155,
    file="Si.tersoff",
    speeds={"P": 72.2921, "S": 21.0408},
)
"""By an older set of parameters, with a C44 of 10 GPa."""
MAGNESIUM = Metal(
    "custom",
    3.184214012458853,
    "eam/fs",
    "Mg_mm.eam.fs",
    "Mg",
    1.5 * 3**0.5,
    orient="a1 1 0 0 a2 0 1.7320508075688772 0 a3 0 0 1.628164204768662 basis 0 0 0 "
    "basis 0.5 0.5 0 basis 0.5 0.8333333333333333 0.5 basis 0 0.3333333333333333 0.5",
)
"""Hexagonal close packed, x along [11-20] and z along [0001]."""
H = COPPER.cell
"""Edge of a cell for copper (angstrom)."""

REFLECTED, TRANSMITTED = 0.004, (0.99, 1.01)
"""Bounds for the packet of `wave_case`. Measured: R = .0013, T = 1.003 for the P wave."""

CRYSTAL = """\
units metal
dimension 3
boundary ${{edge_x}} ${{edge_y}} ${{edge_z}}
atom_style atomic
lattice {metal.structure} {metal.constant!r} origin {metal.place} {metal.orient}
region box block ${{xlo}} ${{xhi}} ${{ylo}} ${{yhi}} ${{zlo}} ${{zhi}} units box
create_box {metal.types} box
create_atoms 1 region box{metal.kinds}
"""

ONE_BOX = "create_atoms 1 region box\n"
TWO_BOXES = """\
region one block ${xlo1} ${xhi1} ${ylo1} ${yhi1} ${zlo1} ${zhi1} units box
region two block ${xlo2} ${xhi2} ${ylo2} ${yhi2} ${zlo2} ${zhi2} units box
region both union 2 one two
create_atoms 1 region both
"""

CELL = """\
units metal
dimension 3
boundary p p p
lattice {metal.structure} {metal.constant!r} origin 0.1 0.1 0.1 {metal.orient}
region box block 0 1 0 1 0 {metal.repeats}
create_box {metal.types} box
create_atoms 1 region box{metal.kinds}
"""

HELD = {"condition": "velocity", "value": [0.0, 0.0, 0.0]}

Ends = tuple[float, float] | None


def copper_case(
    cells: tuple[int, int, int],
    region: tuple[Ends, Ends, Ends],
    end: float,
    metal: Metal = COPPER,
) -> dict[str, Any]:
    """A body of so many cells with held faces, and a box of atoms in it, in cells.

    Along an axis without ends the body is periodic, and full of atoms.
    """
    h = metal.cell
    periodic = [ends is None for ends in region]
    box = [[0.0, count * h] for count in cells]
    edges = {f"edge_{axis}": "p" if p else "s" for axis, p in zip("xyz", periodic, strict=True)}
    return {
        "gimpmd": 1,
        "name": "metal",
        "units": "metal",
        "domain": {"box": box, "periodic": periodic},
        "grid": {"cell": h},
        "time": {"end": end, "md_timestep": 0.002, "md_steps": metal.md_steps},
        "md": {
            "region": [
                span if ends is None else [ends[0] * h, ends[1] * h]
                for span, ends in zip(box, region, strict=True)
            ],
            "input": "crystal.in",
            "minimize": False,
            "variables": edges,
        },
        "continuum": {"material": {"from": "md", "cell": "cell.in"}, "threads": 1},
        "coupling": {"scheme": "sites"},
        "boundary": {face: HELD for k, face in enumerate(FACES) if not periodic[k // 2]},
        "output": {"interval": end, "energy_interval": 1e-6},
    }


def on_levels(case: dict[str, Any], *finest: Ends) -> dict[str, Any]:
    """The case with cells twice as large beyond a box, in cells; it spans an axis without ends."""
    h, box = case["grid"]["cell"], case["domain"]["box"]
    ends = [
        span if pair is None else [pair[0] * h, pair[1] * h]
        for span, pair in zip(box, finest, strict=True)
    ]
    return case | {"grid": {"cell": 2.0 * h, "levels": [{"boxes": [ends]}]}}


def slab_on_levels(end: float) -> dict[str, Any]:
    """Atoms between two planes, in a finer level of a body that is periodic along y and z."""
    case = copper_case((34, 4, 4), ((12.3, 20.7), None, None), end)
    return on_levels(case, (8, 26), None, None)


def wave_case(
    polarization: str,
    wavelength: float = 8.0,
    deeper: float = 0.0,
    way: Literal["out", "into"] = "out",
    metal: Metal = COPPER,
    strain: float = 2e-4,
) -> dict[str, Any]:
    """A packet that leaves a slab of atoms, or enters it; lengths in cells.

    It may start ``deeper`` inside the atoms, or so much farther from them.
    """
    reach, margin, h = 1.25 * metal.cycles * wavelength, 8.0, metal.cell
    middle = math.ceil(2 * reach + margin)
    before, end = math.ceil(deeper) if way == "into" else 0, 2 * middle + math.ceil(deeper)
    edge = before + middle + 0.3
    case = copper_case((end, 2, 2), ((edge, end), None, None), 1.0, metal)
    step, path = 0.002 * metal.md_steps, 2 * reach + margin + deeper
    case["time"]["end"] = step * math.ceil(path * h / metal.speeds[polarization] / step)
    case["output"] = {"interval": case["time"]["end"], "energy_interval": step}
    sign = 1 if way == "into" else -1
    case["initial"] = {
        "packets": [
            {
                "center": (edge - sign * (reach + deeper)) * h,
                "wavelength": wavelength * h,
                "cycles": metal.cycles,
                "strain": strain,
                "direction": sign,
                "polarization": polarization,
            }
        ]
    }
    return case


def wave_on_levels() -> dict[str, Any]:
    """A P packet of one cycle, 8 cells long, that leaves atoms 16 cells before larger cells.

    The run ends when it has left the atoms, and before waves are back from the larger cells.
    """
    length, edge, plane, way = 8.0, 32.3, 34.3, 27.0
    reach = 1.25 * length
    case = copper_case((58, 4, 4), ((edge, 58), None, None), 1.0)
    case = on_levels(case, (16, 58), None, None)
    step = 0.064  # of the larger cells
    end = step * math.ceil(way * H / SPEEDS["P"] / step)
    case["time"]["end"] = end
    case["output"] = {"interval": end, "energy_interval": step}
    case["initial"] = {
        "packets": [
            {
                "center": (plane + reach) * H,
                "wavelength": length * H,
                "cycles": 1.0,
                "strain": 2e-4,
                "direction": -1,
            }
        ]
    }
    return case


def strained(case: dict[str, Any], size: float) -> dict[str, Any]:
    """The case at a uniform strain, which the periodic axes allow."""
    gradient = size * np.array([[1.0, 0.5, 0.3], [0.0, -0.5, 0.2], [-0.1, 0.0, 0.7]])
    gradient[:, case["domain"]["periodic"]] = 0.0
    center = [0.5 * high for _, high in case["domain"]["box"]]
    return case | {"initial": {"stretch": {"gradient": gradient.tolist(), "center": center}}}


def write_scripts(folder: Path, metal: Metal = COPPER) -> None:
    """Write the scripts that cases name."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "crystal.in").write_text(CRYSTAL.format(metal=metal) + metal.potential)
    (folder / "cell.in").write_text(CELL.format(metal=metal) + metal.potential)


def measured_slab(folder: Path, across: int = 2) -> Case:
    """Atoms between two planes, in a body that is periodic along y and z, as LAMMPS measures it."""
    write_scripts(folder)
    cells = (16, across, across)
    case = msgspec.convert(copper_case(cells, ((3.3, 12.7), None, None), 0.32), Case)
    return measured(case, folder)


def silicon_slab() -> dict[str, Any]:
    """Silicon between two planes, in a body that is periodic along y and z."""
    return copper_case((10, 2, 2), ((2.3, 7.7), None, None), 0.16, SILICON)


def two_columns(end: float) -> dict[str, Any]:
    """Two regions of copper in a body that is periodic along y; both have edges."""
    case = copper_case((28, 2, 12), ((2.3, 25.1), None, (2.4, 9.6)), end)
    (low, high), *others = case["md"].pop("region")
    inner = [9.6 * H, 17.7 * H]
    case["md"]["regions"] = [[[low, inner[0]], *others], [[inner[1], high], *others]]
    return case


def write_scripts_of_two(folder: Path) -> None:
    """Write the scripts of two regions of copper."""
    write_scripts(folder)
    script = folder / "crystal.in"
    script.write_text(script.read_text().replace(ONE_BOX, TWO_BOXES))


def below_surface(
    cells: tuple[int, int, int], region: tuple[Ends, Ends, Ends], end: float
) -> dict[str, Any]:
    """The case with a free upper face along z, which the region reaches; its surface has relaxed.

    The lower face along z is held, the others are free.
    """
    case = copper_case(cells, region, end)
    case["boundary"] = {"back": HELD}
    case["md"]["minimize"] = True
    return case


def measured_below_surface(folder: Path) -> Case:
    """A strip of atoms below a free surface, in a body that is periodic along y."""
    write_scripts(folder)
    case = below_surface((12, 2, 8), ((2.3, 9.6), None, (2.3, 8)), 0.32)
    return measured(msgspec.convert(case, Case), folder)
