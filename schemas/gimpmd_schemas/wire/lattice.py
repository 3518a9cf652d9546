"""Question and answer of ``gimpmd-md lattice``: a crystal at zero pressure and temperature."""

from __future__ import annotations

from typing import Literal

import msgspec

Structure = Literal["fcc", "bcc", "sc", "diamond", "hcp", "hex", "sq"]
"""Crystal structures; ``hex`` and ``sq`` are plane."""

Style = Literal["lj", "metal", "real", "si"]


class Potential(msgspec.Struct, frozen=True, kw_only=True):
    """A crystal of one element, by its structure and LAMMPS's commands for the potential.

    Attributes
    ----------
    structure : crystal structure.
    units : unit style.
    pair_style : arguments of the command.
    pair_coeff : arguments of the commands, one each.
    mass : mass of an atom; null: the potential file gives it, or 1 in ``lj`` units.
    """

    structure: Structure
    units: Style
    pair_style: str
    pair_coeff: tuple[str, ...]
    mass: float | None = None


class Question(msgspec.Struct, frozen=True, kw_only=True):
    """What ``gimpmd-md lattice`` is asked: about the cell of a script, or about a potential."""

    script: str | None = None
    potential: Potential | None = None


class Waves(msgspec.Struct, frozen=True, kw_only=True):
    """Speeds of the plane waves along a direction (length / time), the fastest first."""

    direction: str
    speeds: tuple[float, ...]


class Surface(msgspec.Struct, frozen=True, kw_only=True):
    """Energy gamma of a surface (pressure times length), as cut and with its atoms at rest."""

    plane: str
    unrelaxed: float
    relaxed: float


class Crystal(msgspec.Struct, frozen=True, kw_only=True):
    """A crystal at zero pressure and temperature, in the units of the style.

    Attributes
    ----------
    units, dimension : unit style, and number of dimensions.
    structure, constant, ratio : structure, lattice constant a, and c / a of ``hcp``; null for the
        cell of a script.
    factors : edges of the cell over those in the script, one for each axis; null for a potential.
    edges : edge vectors of the cell (length).
    neighbours : distance of nearest neighbours (length).
    energy : potential energy per atom.
    density : mass per area or volume.
    stiffness : elastic constants (pressure), in Voigt order xx, yy, xy or xx, yy, zz, yz, xz, xy.
    waves : along the main directions.
    surfaces : of the planes of low index; of the faces of a script's cell.
    """

    units: Style
    dimension: int
    structure: Structure | None
    constant: float | None
    ratio: float | None
    factors: tuple[float, ...] | None
    edges: tuple[tuple[float, ...], ...]
    neighbours: float
    energy: float
    density: float
    stiffness: tuple[tuple[float, ...], ...]
    waves: tuple[Waves, ...]
    surfaces: tuple[Surface, ...]
