"""Forces and energies of atoms by a calculator of ASE, and what kind of potential it is."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement
from typing import Any

import ase
import numpy as np
from ase.constraints import FixAtoms, FixCartesian
from ase.optimize import FIRE

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.errors import BackendError

CLUSTER = 12
"""Atoms on which the potential is tested for being a sum over pairs."""

SHAKE = 0.02
"""Size of their random displacements, over the cutoff: no symmetry may hide a term."""

SMALL = 1e-6
"""A term of the energy that is smaller than this, relative to a bond, counts as zero."""

LONGEST_STEP = 0.02
"""Longest step of an atom during relaxation, over the cutoff."""

MOST_STEPS = 10_000
"""Steps after which the relaxation gives up, as with LAMMPS."""


class Potential:
    """The forces on a set of atoms.

    Parameters
    ----------
    name : str
        Input of the user, for messages.
    atoms : ase.Atoms
        Copied. Along an axis without period its cell has room for the atoms.
    calculator : ase calculator
    """

    def __init__(self, name: str, atoms: ase.Atoms, calculator: Any) -> None:
        self._name, self._atoms = name, atoms.copy()
        self._atoms.calc = calculator
        x, lengths = atoms.positions, atoms.cell.lengths()
        middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
        # some calculators want atoms inside the cell, whose corner is the origin
        self._offset = np.where(atoms.pbc, 0.0, 0.5 * lengths - middle)

    def move(self, x: Floats) -> None:
        """Set the first components of all positions, ``(n, d)``."""
        dim = x.shape[1]
        self._atoms.positions[:, :dim] = x + self._offset[:dim]

    def forces(self) -> Floats:
        """Forces ``(n, 3)`` on the atoms where they are (energy per length).

        Raises
        ------
        BackendError
            The calculator fails, or a force is not finite.
        """
        f = np.asarray(self._ask("forces"), dtype=np.float64)
        if not np.isfinite(f).all():
            raise BackendError(f"{self._name}: the calculator gives forces that are not finite")
        return f

    def relax(self, free: Bools, dim: int, cutoff: float, tolerance: float) -> Floats:
        """Move free atoms until no force on them is larger than a tolerance.

        Parameters
        ----------
        free : ndarray of bool, shape ``(n,)``
            The atoms that may move.
        dim : int
            In two dimensions they stay in their planes.
        cutoff : float
            Range of the potential (length).
        tolerance : float
            Force.

        Returns
        -------
        ndarray, shape ``(n, dim)``
            Positions.

        Raises
        ------
        BackendError
            The forces do not become small.
        """
        fixed = [FixAtoms(mask=~free)]
        if dim == 2:
            fixed.append(FixCartesian(np.arange(len(free)), mask=(False, False, True)))
        self._atoms.set_constraint(fixed)
        search = FIRE(self._atoms, logfile=None, maxstep=LONGEST_STEP * cutoff)
        try:
            done = search.run(fmax=tolerance, steps=MOST_STEPS)
        except Exception as error:  # of a code that is not ours
            raise BackendError(f"{self._name}: the calculator failed: {error!r}") from error
        if not done:
            raise BackendError(
                f"{self._name}: the atoms do not come to rest in {MOST_STEPS} steps; start closer "
                "to equilibrium, or write md.minimize: false"
            )
        self._atoms.set_constraint()
        return (self._atoms.positions - self._offset)[:, :dim]

    def energy(self) -> float:
        """Potential energy of all atoms."""
        return float(self._ask("energy"))

    def has(self, quantity: str) -> bool:
        """Whether the calculator gives ``energies`` or ``stresses`` of single atoms."""
        return quantity in self._atoms.calc.implemented_properties

    def energies(self) -> Floats:
        """Potential energy of every atom, ``(n,)``."""
        return np.asarray(self._ask("energies"), dtype=np.float64)

    def virials(self) -> Floats:
        """Stress times volume of every atom (energy units), ``(n, 6)`` in the order of ASE."""
        return np.asarray(self._ask("stresses")) * self._atoms.cell.volume

    def _ask(self, quantity: str) -> Any:
        try:
            return self._atoms.calc.get_property(quantity, self._atoms)
        except Exception as error:  # of a code that is not ours
            raise BackendError(f"{self._name}: the calculator failed: {error!r}") from error


def check_range(name: str, atoms: ase.Atoms, calculator: Any, cutoff: float) -> None:
    """Check that two atoms further apart than the cutoff do not act on each other.

    Raises
    ------
    BackendError
        They do.
    """

    def energy(species: tuple[str, ...], distance: float) -> float:
        positions = np.zeros((len(species), 3))
        positions[1:, 0] = distance
        return _alone(name, ase.Atoms(list(species), positions), calculator, cutoff)

    kinds = sorted(set(atoms.get_chemical_symbols()))
    for pair in combinations_with_replacement(kinds, 2):
        apart = sum(energy((one,), 0.0) for one in pair)
        beyond, bond = energy(pair, 1.0001 * cutoff) - apart, energy(pair, 0.5 * cutoff) - apart
        if abs(beyond) > SMALL * abs(bond):
            raise BackendError(
                f"{name}: the calculator gives two atoms {' and '.join(pair)} at a distance of "
                f"{1.0001 * cutoff:g} an energy of {beyond:.3g}, but md.cutoff is {cutoff:g}; "
                "set md.cutoff to the range of the potential"
            )


def is_pairwise(name: str, atoms: ase.Atoms, calculator: Any, cutoff: float) -> bool:
    """Whether the potential is a sum over pairs of atoms.

    For three disjoint sets of atoms such a sum is the energy of each two of them together less that
    of each alone. A term that depends on three atoms or more would be missing.
    """
    x = atoms.positions
    near = np.argsort(((x - np.median(x, axis=0)) ** 2).sum(axis=1), kind="stable")[:CLUSTER]
    cluster = atoms[near]
    cluster.positions += SHAKE * cutoff * np.random.default_rng(1).uniform(-1, 1, (len(near), 3))
    if len(cluster) < 3:
        return True
    sets = [np.arange(start, len(cluster), 3) for start in range(3)]

    def energy(*parts: np.ndarray) -> float:
        return _alone(name, cluster[np.sort(np.concatenate(parts))], calculator, cutoff)

    whole, single = energy(*sets), sum(energy(one) for one in sets)
    pairs = sum(energy(*two) for two in combinations(sets, 2)) - single
    return abs(whole - pairs) <= SMALL * abs(whole - single)


def _alone(name: str, atoms: ase.Atoms, calculator: Any, cutoff: float) -> float:
    """Energy of some atoms in empty space."""
    atoms.set_pbc(False)
    atoms.set_cell(np.ptp(atoms.positions, axis=0) + 4.0 * cutoff)
    found = Potential(name, atoms, calculator)
    found.move(atoms.positions)
    return found.energy()
