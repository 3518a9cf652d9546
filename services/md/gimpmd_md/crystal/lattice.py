"""A crystal at zero pressure and temperature in LAMMPS: lattice, energies, elastic constants."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from msgspec.structs import replace as structs_replace

from gimpmd_md.crystal.cell import Cell, cell_of, open_cell, settled
from gimpmd_md.crystal.equilibrium import FACTORS, at_rest, near_rest
from gimpmd_md.crystal.structures import CELLS, DIRECTIONS, Plane, atoms
from gimpmd_md.crystal.surface import surface_energy
from gimpmd_md.engines.lammps.library import Engine, unit_style
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import plane_wave_moduli
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.lattice import Crystal, Potential, Question, Style, Surface, Waves

START = {"lj": 1.5, "metal": 4.0, "real": 4.0, "si": 4e-10}
"""Lattice constant of the cell in which LAMMPS tells the range of the potential, by unit style."""

DISTANCES = np.geomspace(0.25, 0.98, 60)
"""Distances of nearest neighbours at which energies are compared, in ranges of the potential."""

_AXES: Mapping[int, Mapping[str, tuple[int, ...]]] = {
    2: {"x": (1, 0), "y": (0, 1)},
    3: {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)},
}

NO_MASS = 1e-9
"""Mass that stays only if the potential gives none."""


def answer(question: Question, comm: Any) -> Crystal:
    """Find a crystal at zero pressure and temperature, and measure it.

    Raises
    ------
    BackendError
        LAMMPS refuses the script or the potential, or there is no such crystal.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.lammps"
        if question.script is not None:
            return _of_script(question.script, comm, log)
        if question.potential is None:
            raise BackendError("name a LAMMPS script, or a potential and a crystal structure")
        return _of_potential(question.potential, comm, log)


def _of_script(script: str, comm: Any, log: Path) -> Crystal:
    def opened() -> Any:
        return open_cell(script, None, comm, log, dims=(2, 3))

    with opened() as cell:
        F, C = at_rest(cell, near_rest(cell, FACTORS) * np.eye(len(cell.box)))
        edges = F @ cell.box
        found = _measured(replace(cell, box=edges), C, _AXES[len(edges)])
        factors = tuple((np.linalg.norm(edges, axis=0) / np.linalg.norm(cell.box, axis=0)).tolist())
    upright = np.abs(edges - np.diag(np.diag(edges))).max() < 1e-6 * edges[0, 0]
    surfaces = []
    for axis in range(len(edges) if upright else 0):
        with opened() as cell:
            name = f"normal to {'xyz'[axis]}"
            surfaces.append(_surface(replace(cell, box=edges), Plane(name, axis)))
    return structs_replace(found, factors=factors, surfaces=tuple(surfaces))


def _of_potential(potential: Potential, comm: Any, log: Path) -> Crystal:
    start, structure = START[potential.units], CELLS[potential.structure]
    one = np.ones(len(structure.edges))
    with _open_crystal(potential, start * one, None, comm, log) as cell:
        reach, closest = cell.engine.pair_cutoff(), _least_distance(cell)
        factor = near_rest(cell, (reach / closest * DISTANCES).tolist())
        there = replace(cell, box=factor * cell.box)
        there = settled(there)  # at the start the atoms may be far from rest
        F, C = at_rest(there, np.eye(len(one)))
        scale = start * factor * np.diag(F)
        cubic = len(set(structure.edges)) == 1
        directions = DIRECTIONS[len(one)] if cubic else _AXES[len(one)]
        found = _measured(replace(there, box=F @ there.box), C, directions)
    surfaces = []
    for plane in structure.planes:
        with _open_crystal(potential, scale, plane.axes, comm, log) as cell:
            surfaces.append(_surface(settled(cell), plane))
    ratio = None
    if potential.structure == "hcp":
        ratio = float(structure.edges[2] * scale[2] / scale[0])
    return structs_replace(
        found,
        structure=potential.structure,
        constant=float(scale[0]),
        ratio=ratio,
        surfaces=tuple(surfaces),
    )


@contextmanager
def _open_crystal(
    potential: Potential,
    scale: Floats,
    axes: tuple[tuple[int, ...], ...] | None,
    comm: Any,
    log: Path,
) -> Iterator[Cell]:
    """A cell of a structure with the potential; LAMMPS is closed at the end.

    Parameters
    ----------
    scale : ndarray, shape ``(d,)``
        Lattice constant along each axis.
    axes : tuple, optional
        See `structures.atoms`.
    """
    edges, x = atoms(potential.structure, axes)
    edges, x = edges * scale, x * scale
    dim, name = len(edges), f"{potential.structure}, pair_style {potential.pair_style}"
    sides = [*(f"0 {edge:.17g}" for edge in edges), "-0.5 0.5"][:3]
    engine = Engine(comm, log)
    try:
        engine.commands(
            [
                *unit_style(potential.units),
                f"dimension {dim}",
                "boundary p p p",
                "atom_style atomic",
                f"region cell block {' '.join(sides)} units box",
                "create_box 1 cell",
            ]
        )
        places = np.zeros((len(x), 3))
        places[:, :dim] = x
        ids = list(range(1, len(x) + 1))
        engine.lammps.create_atoms(len(x), ids, [1] * len(x), places.ravel().tolist())
        engine.commands(
            [
                f"mass 1 {potential.mass or (1.0 if potential.units == 'lj' else NO_MASS)}",
                f"pair_style {potential.pair_style}",
                *(f"pair_coeff {words}" for words in potential.pair_coeff),
                "neigh_modify one 20000 page 2000000",
            ]
        )
        if potential.mass is not None:
            engine.commands([f"mass 1 {potential.mass}"])  # rather than that of the potential
        if engine.masses()[0] == NO_MASS:
            raise BackendError(
                f"{name}: the potential gives no mass of the atoms; give it with --mass"
            )
        yield cell_of(name, engine)
    finally:
        engine.close()


def _measured(cell: Cell, C: Floats, directions: Mapping[str, tuple[int, ...]]) -> Crystal:
    """Energies, elastic constants and waves of a cell at rest."""
    engine, dim = cell.engine, len(cell.box)
    style = str(engine.lammps.extract_global("units"))
    cell.deform(np.eye(dim))
    density = engine.evaluate("mass(all)") / float(np.linalg.det(cell.box))
    waves = []
    for name, direction in directions.items():
        moduli = UNITS[style].stress_to_mechanical(1.0) * plane_wave_moduli(C, np.array(direction))
        speeds = np.sqrt(moduli / density)
        waves.append(Waves(direction=name, speeds=tuple(speeds.tolist())))
    return Crystal(
        units=cast(Style, style),
        dimension=dim,
        structure=None,
        constant=None,
        ratio=None,
        factors=None,
        edges=tuple(tuple(edge) for edge in cell.box.T.tolist()),
        neighbours=_least_distance(cell),
        energy=engine.thermo("pe") / engine.lammps.get_natoms(),
        density=density,
        stiffness=tuple(tuple(row) for row in C.tolist()),
        waves=tuple(waves),
        surfaces=(),
    )


def _least_distance(cell: Cell) -> float:
    """Distance from the first atom to its nearest neighbours."""
    return float(np.linalg.norm(cell.around(), axis=1).min())


def _surface(cell: Cell, plane: Plane) -> Surface:
    unrelaxed, relaxed = surface_energy(cell, plane.axis)
    return Surface(plane=plane.name, unrelaxed=unrelaxed, relaxed=relaxed)
