"""Thermal stress of a crystal of any potential, from its lattice vibrations in LAMMPS.

In the classical quasi-harmonic approximation (Born and Huang, Dynamical Theory of Crystal Lattices,
1954) vibrations add ``k T / 2 <ln det D(q)>`` to the energy of a primitive cell, with the dynamical
matrix D without masses and the mean over wave vectors q. Its derivative with respect to strain is
the thermal stress. The approximation neglects terms of second order in the temperature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gimpmd_md.crystal.cell import Cell, cell_of
from gimpmd_md.crystal.recognise import Crystal, distances, recognise
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.units import UNITS

STRAIN = 5e-4
"""Strain of the central differences of force constants."""

STEP = 1e-3
"""Displacement of an atom in the differences of forces, over the least distance of atoms."""

REACH = 2.0
"""Range of the force constants, in cutoffs: two atoms may share a neighbour."""

WAVES = {2: (32, 64), 3: (8, 16)}
"""Wave vectors along each axis of the reciprocal cell, by dimension. The response depends on the
direction at q = 0, so the error of the mean is that number to the power of minus the dimension. The
mean is extrapolated from two of them."""

UNSTABLE = 1e-9
"""A crystal is unstable if its least stiffness of a vibration, over the largest, is below this."""

NEGLIGIBLE = 1e-4
"""Components smaller than this, over the largest, are zero by symmetry: errors of differences."""


@dataclass(frozen=True)
class _Large:
    """A periodic cell that is larger than twice the range of the force constants.

    Attributes
    ----------
    cell : Cell
    home : ndarray of int, shape ``(b,)``
        Indices of the atoms of one primitive cell, among atoms in the order of their ids.
    member : ndarray of int, shape ``(n,)``
        Which of them each atom is a translation of.
    away : ndarray, shape ``(b, n, d)``
        Shortest vectors from the atoms of that cell to all atoms at rest.
    step : float
        Displacement of an atom (length).
    """

    cell: Cell
    home: Ints
    member: Ints
    away: Floats
    step: float


def thermal_stress(cell: Cell) -> Floats:
    """Second Piola-Kirchhoff stress at rest that vibrations cause, for each unit of temperature.

    It is negative (a pressure) where they expand the crystal. Afterwards LAMMPS holds a larger
    cell.

    Parameters
    ----------
    cell : Cell
        A periodic cell at rest, with any number of atoms in its primitive cell.

    Returns
    -------
    ndarray, shape ``(c,)``
        Pressure over temperature, units of the style, in Voigt order.

    Raises
    ------
    BackendError
        The atoms form no crystal, or it is unstable.
    """
    dim = len(cell.box)
    cell.deform(np.eye(dim))
    crystal = _crystal(cell)
    large = _enlarged(cell, crystal)
    rest = _constants(large, np.zeros((dim, dim)))
    changes = []
    for i, j in VOIGT[dim]:
        strain = np.zeros((dim, dim))
        strain[i, j] = STRAIN
        changes.append((_constants(large, strain) - _constants(large, -strain)) / (2.0 * STRAIN))
    coarse, fine = (_mean(large, crystal, rest, np.array(changes), n) for n in WAVES[dim])
    ratio = (WAVES[dim][1] / WAVES[dim][0]) ** dim
    mean = (ratio * fine - coarse) / (ratio - 1.0)
    units = UNITS[str(cell.engine.lammps.extract_global("units"))]
    stress = 0.5 * units.boltz * units.nktv2p / crystal.volume * mean
    stress[np.abs(stress) < NEGLIGIBLE * np.abs(stress).max()] = 0.0
    return np.asarray(stress)


def _crystal(cell: Cell) -> Crystal:
    """The crystal that fills the cell and its periodic images."""
    x, kinds = cell.engine.vectors("x").copy(), cell.engine.atoms("type").copy()
    shifts = cell.images()
    try:
        return recognise((x + shifts[:, None]).reshape(-1, x.shape[1]), np.tile(kinds, len(shifts)))
    except BackendError as error:
        raise BackendError(f"{cell.script}: continuum.temperature: {error}") from None


def _enlarged(cell: Cell, crystal: Crystal) -> _Large:
    """Repeat the cell in LAMMPS."""
    engine, dim = cell.engine, len(cell.box)
    width = 1.0 / np.linalg.norm(np.linalg.inv(cell.box), axis=1)
    times = np.ceil(2.0 * REACH * engine.pair_cutoff() / width).astype(int)
    engine.commands([f"replicate {' '.join(map(str, [*times, 1][:3]))}"])
    whole = replace(cell_of(cell.script, engine), tolerance=cell.tolerance)
    whole.deform(np.eye(dim))
    x = engine.vectors_by_id("x")
    member = distances(crystal.vectors, x[0], _from_first(crystal, x[0]), x).argmin(axis=0)
    home = np.array([np.flatnonzero(member == b)[0] for b in range(len(crystal.basis))])
    away = x - x[home][:, None]
    away -= np.rint(away @ np.linalg.inv(whole.box).T) @ whole.box.T
    least = np.linalg.norm(whole.around(), axis=1).min()
    return _Large(whole, home, member, away, STEP * float(least))


def _from_first(crystal: Crystal, first: Floats) -> Floats:
    """Places of the atoms of a primitive cell relative to one atom of the crystal."""
    own = distances(crystal.vectors, crystal.origin, crystal.basis, first[None]).argmin()
    return np.asarray(crystal.basis - crystal.basis[own])


def _constants(large: _Large, strain: Floats) -> Floats:
    """Force constants between the atoms of one primitive cell and all atoms of the strained cell.

    Parameters
    ----------
    strain : ndarray, shape ``(d, d)``
        Displacement gradient, upper triangular.

    Returns
    -------
    ndarray, shape ``(b, d, n, d)``
        Minus the derivative of the force on an atom (third and fourth index) with respect to the
        displacement of one of the primitive cell (first and second index).
    """
    cell, dim = large.cell, len(strain)
    cell.deform(np.eye(dim) + strain)
    found = np.empty((len(large.home), dim, len(large.member), dim))
    for (b, atom), axis in product(enumerate(large.home.tolist()), range(dim)):
        pushed = [_forces(cell, atom, axis, s * large.step) for s in (1.0, -1.0)]
        found[b, axis] = (pushed[1] - pushed[0]) / (2.0 * large.step)
        found[b, axis, atom] -= found[b, axis].sum(axis=0)  # a translation has no force
    return found


def _forces(cell: Cell, atom: int, axis: int, step: float) -> Floats:
    """Forces on all atoms while one is displaced, by id."""
    engine = cell.engine

    def move(by: float) -> None:
        engine.vectors("x")[engine.atoms("id") == atom + 1, axis] += by

    move(step)
    engine.commands(["run 0 post no"])
    forces = engine.vectors_by_id("f")
    move(-step)
    return forces


def _mean(large: _Large, crystal: Crystal, rest: Floats, changes: Floats, n: int) -> Floats:
    """Mean of ``tr(D^-1 dD)`` over ``n^d`` wave vectors, none zero, for each change; ``(c,)``."""
    dim = len(crystal.vectors)
    reciprocal = 2.0 * np.pi * np.linalg.inv(crystal.vectors).T
    part = (np.arange(n) + 0.5) / n
    total = np.zeros(len(changes))
    for first in part[: (n + 1) // 2]:  # D(-q) is the conjugate of D(q)
        others = np.stack(np.meshgrid(*[part] * (dim - 1), indexing="ij"), axis=-1)
        q = np.insert(others.reshape(-1, dim - 1), 0, first, axis=1) @ reciprocal
        D = _dynamical(large, rest, q)
        stiffness = np.linalg.eigvalsh(D)
        if stiffness.min() <= UNSTABLE * stiffness.max():
            raise BackendError(
                f"{large.cell.script}: continuum.temperature: the crystal is unstable at rest, so "
                "its vibrations are unknown; check the lattice constant, or leave the key out"
            )
        inverse = np.linalg.inv(D)
        for m, change in enumerate(changes):
            total[m] += np.einsum("qij,qji->", inverse, _dynamical(large, change, q)).real
    return 2.0 * total / n**dim


def _dynamical(large: _Large, constants: Floats, q: Floats) -> Floats:
    """Dynamical matrices without masses at wave vectors ``(w, d)``, shape ``(w, b d, b d)``."""
    count, dim = len(large.home), q.shape[1]
    D = np.zeros((len(q), count, dim, count, dim), complex)
    for b in range(count):
        phase = np.exp(1j * q @ large.away[b].T)
        for other in range(count):
            these = large.member == other
            D[:, other, :, b, :] = np.einsum(
                "wn,cna->wac", phase[:, these], constants[b][:, these], optimize=True
            )
    square = D.reshape(len(q), count * dim, count * dim)
    return np.asarray(0.5 * (square + square.conj().swapaxes(1, 2)))
