"""``gimpmd lattice``: a crystal at zero pressure and temperature."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from rich.table import Table

from gimpmd_deploy.cli.options import Json, print_json, standard_output
from gimpmd_deploy.launch.lattice import lattice_of_potential, lattice_of_script
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.lattice import Crystal

SAME = 1e-4
"""Relative difference up to which elastic constants count as equal."""


class StructureName(StrEnum):
    """Crystal structures; hex and sq are plane."""

    fcc = "fcc"
    bcc = "bcc"
    sc = "sc"
    diamond = "diamond"
    hcp = "hcp"
    hex = "hex"
    sq = "sq"


class UnitStyle(StrEnum):
    """Unit styles of LAMMPS that gimpmd knows."""

    lj = "lj"
    metal = "metal"
    real = "real"
    si = "si"


def lattice(
    script: Annotated[
        Path | None,
        typer.Argument(metavar="[CELL.in]", help="LAMMPS script of a periodic cell, or:"),
    ] = None,
    pair: Annotated[str | None, typer.Option("--pair", help="Arguments of pair_style.")] = None,
    file: Annotated[str | None, typer.Option("--file", help="Potential file.")] = None,
    element: Annotated[
        list[str] | None, typer.Option("--element", help="Element, after the potential file.")
    ] = None,
    coeff: Annotated[
        list[str] | None,
        typer.Option("--coeff", help="Arguments of pair_coeff, in place of --file."),
    ] = None,
    crystal: Annotated[
        StructureName | None, typer.Option("--crystal", help="Crystal structure.")
    ] = None,
    units: Annotated[UnitStyle | None, typer.Option("--units", help="Unit style.")] = None,
    mass: Annotated[
        float | None, typer.Option("--mass", help="Mass, if the file gives none.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a crystal at zero pressure: lattice and elastic constants, waves, surface energies."""
    if script is not None:
        if pair or file or coeff or crystal:
            hint = "give either a LAMMPS script or a potential"
            problem = Problem("CELL.in", str(script), "is given in addition to a potential", hint)
            raise InputError("gimpmd lattice", [problem])
        found = lattice_of_script(script)
    else:
        found = lattice_of_potential(pair, crystal, units, file, element or [], coeff or [], mass)
    if as_json:
        print_json(found)
    else:
        standard_output().print(_table(found))


class Scales(NamedTuple):
    """Factors from the unit style to what people read, and the names of these units."""

    modulus: float
    modulus_unit: str
    surface: float
    surface_unit: str
    speed: float
    speed_unit: str
    density: float
    density_unit: str


PASCAL = {"metal": 1e5, "real": 101325.0, "si": 1.0}
METRE = {"metal": 1e-10, "real": 1e-10, "si": 1.0}
SECOND = {"metal": 1e-12, "real": 1e-15, "si": 1.0}
KILOGRAM = {"metal": 1.66053907e-27, "real": 1.66053907e-27, "si": 1.0}
"""SI units in one unit of the style, and in one dalton."""


def scales(found: Crystal) -> Scales:
    """Units of the table: GPa, mJ/m^2, m/s and g/cm^3 in three dimensions, else those of the style.

    In two dimensions pressures are those of a body of unit thickness, so GPa would mean nothing.
    """
    style, units, dim = found.units, UNITS[found.units], found.dimension
    if style == "lj" or dim == 2:
        pressure = units.pressure.replace("^d", f"^{dim}")
        surface = f"{pressure} {units.length}"
        if style == "lj":
            surface = f"{units.energy}/{units.length}" + ("^2" if dim == 3 else "")
        speed, density = f"{units.length}/{units.time}", f"{units.mass}/{units.length}^{dim}"
        return Scales(1.0, pressure, 1.0, surface, 1.0, speed, 1.0, density)
    return Scales(
        modulus=1e-9 * PASCAL[style],
        modulus_unit="GPa",
        surface=1e3 * PASCAL[style] * METRE[style],
        surface_unit="mJ/m^2",
        speed=METRE[style] / SECOND[style],
        speed_unit="m/s",
        density=1e-3 * KILOGRAM[style] / METRE[style] ** 3,
        density_unit="g/cm^3",
    )


def elastic_constants(found: Crystal) -> Iterator[tuple[str, float]]:
    """Names and values of the constants that differ from zero; the three of a cubic crystal."""
    C = np.array(found.stiffness)
    names = (1, 2, 6) if found.dimension == 2 else (1, 2, 3, 4, 5, 6)
    size, dim = SAME * np.abs(C).max(), found.dimension
    longitudinal, shear = np.diag(C)[:dim], np.diag(C)[dim:]
    across = C[:dim, :dim][np.triu_indices(dim, 1)]
    if all(np.ptp(values) < size for values in (longitudinal, shear, across)):
        last = names[dim]
        yield from (("C11", C[0, 0]), ("C12", C[0, 1]), (f"C{last}{last}", C[dim, dim]))
        return
    for row, i in enumerate(names):
        for column, j in enumerate(names[row:], start=row):
            if abs(C[row, column]) > size:
                yield f"C{i}{j}", float(C[row, column])


def _table(found: Crystal) -> Table:
    units, scale = UNITS[found.units], scales(found)
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim")
    grid.add_row("state", "zero pressure and temperature")
    for name, text in _lattice_rows(found):
        grid.add_row(name, text)
    grid.add_row("nearest neighbours", f"{found.neighbours:.8g} {units.length}")
    grid.add_row("energy per atom", f"{found.energy:.8g} {units.energy}")
    grid.add_row("density", f"{scale.density * found.density:.6g} {scale.density_unit}")
    constants = [f"{name} = {scale.modulus * c:.6g}" for name, c in elastic_constants(found)]
    grid.add_row("elastic constants", f"{', '.join(constants)} {scale.modulus_unit}")
    for waves in found.waves:
        speeds = ", ".join(f"{scale.speed * speed:.5g}" for speed in waves.speeds)
        grid.add_row(f"waves along {waves.direction}", f"{speeds} {scale.speed_unit}")
    for surface in found.surfaces:
        cut, rest = (scale.surface * g for g in (surface.unrelaxed, surface.relaxed))
        text = f"{rest:.5g} {scale.surface_unit}, as cut {cut:.5g}"
        grid.add_row(f"surface {surface.plane}", text)
    return grid


def _lattice_rows(found: Crystal) -> Iterator[tuple[str, str]]:
    length = UNITS[found.units].length
    if found.constant is not None:
        ratio = "" if found.ratio is None else f", c/a = {found.ratio:.6g}"
        yield "lattice constant", f"{found.constant:.8g} {length} ({found.structure}){ratio}"
    if found.factors is not None:
        edges = " x ".join(f"{np.linalg.norm(edge):.8g}" for edge in found.edges)
        yield "cell at rest", f"{edges} {length}"
        factors = ", ".join(f"{factor:.8g}" for factor in found.factors)
        yield "over that of the script", factors
