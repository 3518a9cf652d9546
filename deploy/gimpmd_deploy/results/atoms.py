"""Atoms over time, from ``atoms/atoms.dump``, and the lattice that they form."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from gimpmd_deploy.results.particles import Particles, voigt_names
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain import dump

INTEGERS = ("id", "type")
OPTIONAL = ("mass", "potential_energy")
"""Columns that become fields of the atoms, the latter where the dump has them."""

SAMPLE = 4000
"""Atoms from which the lattice is measured: those nearest to the middle of the body."""

FLAT = 1e-6
"""Simplices with less than this fraction of the largest volume are degenerate."""


class AtomsFile:
    """Atoms over time in a LAMMPS text dump.

    Attributes
    ----------
    times : list of float
        Times of the frames that were written completely.
    counts : list of int
        Number of atoms in each of them.
    dim : int
        2, or 3 if the dump has the column ``Z0``.
    """

    def __init__(self, path: Path, timestep: float) -> None:
        self.path = path
        self._frames = dump.index(path)
        self.times = [frame.step * timestep for frame in self._frames]
        self.counts = [frame.atoms for frame in self._frames]
        self.dim = 3 if any("Z0" in frame.columns for frame in self._frames) else 2

    @cached_property
    def lattice(self) -> tuple[float, float]:
        """Distance of neighbours, and area (in three dimensions volume) of an atom."""
        return lattice_of(self.columns(0, self._axes("{}0", upper=True)))

    @cached_property
    def _first_energies(self) -> Floats:
        """Potential energies of the atoms in the first frame, in the order of the ids."""
        return self.columns(0, ("potential_energy",))[:, 0]

    def _axes(self, form: str, upper: bool = False) -> tuple[str, ...]:
        letters = ("XYZ" if upper else "xyz")[: self.dim]
        return tuple(form.format(letter) for letter in letters)

    def read(self, index: int) -> Particles:
        """Return the atoms of one frame.

        If the dump has their potential energies, the field ``energy_density`` is the energy that an
        atom has gained since the first frame, per area or volume of an atom.
        """
        vectors = [self._axes("{}0", upper=True), *map(self._axes, ("{}", "u{}", "v{}"))]
        per_atom = "area" if self.dim == 2 else "volume"
        stress = tuple(f"s{ij}_{per_atom}" for ij in voigt_names(self.dim))
        optional = tuple(name for name in OPTIONAL if name in self._frames[index].columns)
        names = (*(name for vector in vectors for name in vector), *stress, *INTEGERS, *optional)
        columns = dict(zip(names, self.columns(index, names).T, strict=True))
        reference, position, displacement, velocity = (
            np.column_stack([columns[name] for name in vector]) for vector in vectors
        )
        spacing, volume = self.lattice
        fields = {name: columns[name].astype(np.int64) for name in INTEGERS}
        fields |= {name: columns[name] for name in optional}
        if "potential_energy" in fields:
            gain = fields["potential_energy"] - self._first_energies
            fields["energy_density"] = gain / volume
        return Particles(
            time=self.times[index],
            reference=reference,
            position=position,
            displacement=displacement,
            velocity=velocity,
            stress=np.column_stack([columns[name] for name in stress]) / volume,
            size=np.full(position.shape, spacing),
            fields=fields,
        )

    def columns(self, index: int, names: tuple[str, ...]) -> Floats:
        """Return columns of one frame, one row for each atom in the order of the ids.

        Raises
        ------
        InputError
            The dump lacks a column, or the frame cannot be read.
        """
        place = self._frames[index]
        missing = [name for name in ("id", *names) if name not in place.columns]
        if missing:
            hint = "run the case again with this version"
            problem = Problem("ITEM: ATOMS", None, f"has no column {missing[0]}", hint)
            raise InputError(str(self.path), [problem])
        data = dump.read_frame(self.path, place).numbers(("id", *names))
        return data[np.argsort(data[:, 0])][:, 1:]


def lattice_of(sites: Floats) -> tuple[float, float]:
    """Measure the distance of neighbours, and the area or volume of an atom, in a crystal.

    A Delaunay triangulation of a plane or cubic Bravais lattice with one atom in its primitive cell
    consists of simplices with 1 / d! of the cell's volume. Medians ignore cracks and edges.

    Parameters
    ----------
    sites : ndarray, shape ``(n, d)``
    """
    # takes most of a second, which a report does not need
    from scipy.spatial import Delaunay, cKDTree

    dim = sites.shape[1]
    if len(sites) <= dim:
        return 1.0, 1.0
    sample = sites[np.argsort(((sites - sites.mean(axis=0)) ** 2).sum(axis=1))[:SAMPLE]]
    spacing = float(np.median(cKDTree(sample).query(sample, k=2)[0][:, 1]))
    corners = sample[Delaunay(sample).simplices]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))  # d! times each simplex
    return spacing, float(np.median(volumes[volumes > FLAT * volumes.max()]))
