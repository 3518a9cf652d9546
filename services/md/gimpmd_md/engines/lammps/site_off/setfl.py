"""Tables of the embedded-atom method: funcfl and setfl files of LAMMPS.

The energy of a site is ``V_i = F(sum_j rho(r_ij)) + sum_j phi(r_ij) / 2`` [1]_. A setfl file has
one table of ``rho`` for each element (``eam/alloy``), or for each ordered pair of elements
(``eam/fs``) [2]_. A funcfl file (``eam``) has one element.

.. [1] M. S. Daw, M. I. Baskes, Phys. Rev. B 29, 6443 (1984).
.. [2] M. W. Finnis, J. E. Sinclair, Philos. Mag. A 50, 45 (1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError

HARTREE_BOHR = 27.2 * 0.529
"""LAMMPS's factor (eV Angstrom) between the product of charges of a funcfl file and ``r phi``."""

OFF = "0"
"""What the name of an element gets when its sites are off."""


@dataclass(frozen=True, eq=False)
class Tables:
    """Functions of the embedded-atom method at evenly spaced points, for n elements.

    Attributes
    ----------
    comment : str
        First line of the file; LAMMPS reads the units from it.
    names : tuple of str
        Names of the elements.
    heads : tuple of str
        For each element its number, mass, lattice constant and structure.
    drho, dr : float
        Spacings of density and distance; both start at 0.
    cutoff : float
    F : ndarray, shape ``(n, nrho)``
        Embedding energies.
    rho : ndarray, shape ``(n, nr)`` or ``(n, n, nr)``
        Densities that an atom of the first element makes, at one of the second.
    z : ndarray, shape ``(n, n, nr)``
        Distance times pair energy.
    """

    comment: str
    names: tuple[str, ...]
    heads: tuple[str, ...]
    drho: float
    dr: float
    cutoff: float
    F: Floats
    rho: Floats
    z: Floats

    def take(self, names: Sequence[str]) -> Tables:
        """Tables of some of the elements.

        Raises
        ------
        BackendError
            An element is not in the tables.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise BackendError(
                f"pair_coeff: the potential file has no element {missing[0]}, only "
                f"{', '.join(self.names)}"
            )
        at = np.array([self.names.index(name) for name in names])
        pair_densities = self.rho.ndim == 3
        return replace(
            self,
            names=tuple(names),
            heads=tuple(self.heads[k] for k in at),
            F=self.F[at],
            rho=self.rho[np.ix_(at, at)] if pair_densities else self.rho[at],
            z=self.z[np.ix_(at, at)],
        )


def with_off_sites(tables: Tables) -> Tables:
    """Tables with a second element ``X0`` for each element ``X``, whose sites are off.

    ``X0`` has no embedding energy, and makes the same density as ``X``. The energy of a pair counts
    half if one of its atoms is off, and not at all if both are.

    Returns
    -------
    Tables
        Of 2 n elements, those that are off last.
    """
    n = len(tables.names)
    on = np.repeat([0.5, 0.0], n)
    twice = np.tile(np.arange(n), 2)
    pair_densities = tables.rho.ndim == 3
    return replace(
        tables,
        names=(*tables.names, *(name + OFF for name in tables.names)),
        heads=tables.heads * 2,
        F=np.concatenate([tables.F, np.zeros_like(tables.F)]),
        rho=tables.rho[np.ix_(twice, twice)] if pair_densities else tables.rho[twice],
        z=tables.z[np.ix_(twice, twice)] * (on[:, None, None] + on[None, :, None]),
    )


def read_setfl(path: Path, pair_densities: bool) -> Tables:
    """Read a setfl file.

    Parameters
    ----------
    pair_densities : bool
        Whether it is one of ``eam/fs``.

    Raises
    ------
    BackendError
        The file is not of this format.
    """
    lines = path.read_text(errors="replace").splitlines()
    try:
        count, *names = lines[3].split()
        n = int(count)
        nrho, drho, nr, dr, cutoff = _sizes(lines[4])
        words = _Words(lines[5:])
        heads, F, rho = [], [], []
        for _ in range(n):
            heads.append(" ".join(words.take(4)))
            F.append(words.numbers(nrho))
            rho.append(
                words.numbers(n * nr).reshape(n, nr) if pair_densities else words.numbers(nr)
            )
        z = np.empty((n, n, nr))
        for i in range(n):
            for j in range(i + 1):
                z[i, j] = z[j, i] = words.numbers(nr)
        words.end()
    except (IndexError, ValueError) as error:
        style = "eam/fs" if pair_densities else "eam/alloy"
        raise BackendError(f"{path}: is no potential file of pair_style {style}: {error}") from None
    return Tables(
        lines[0], tuple(names[:n]), tuple(heads), drho, dr, cutoff, np.array(F), np.array(rho), z
    )


def read_funcfls(paths: Sequence[Path], names: Sequence[str]) -> Tables:
    """Read funcfl files, one of each element, as tables of elements with these names.

    LAMMPS leaves out the last row of each of its tables; so do the tables returned.

    Raises
    ------
    BackendError
        A file is not of this format, or the files have tables with different spacings.
    """
    files = [_read_funcfl(path) for path in paths]
    first = files[0]
    for path, file in zip(paths, files, strict=True):
        if (file.drho, file.dr, len(file.F), len(file.rho)) != (
            first.drho,
            first.dr,
            len(first.F),
            len(first.rho),
        ):
            raise BackendError(
                f"pair_style eam: the tables of {path} and {paths[0]} have different spacings; use "
                "an eam/alloy file of both elements"
            )
    charge = np.array([file.charge for file in files])
    return Tables(
        comment=first.comment,
        names=tuple(names),
        heads=tuple(file.head for file in files),
        drho=first.drho,
        dr=first.dr,
        cutoff=max(file.cutoff for file in files),
        F=np.array([file.F[:-1] for file in files]),
        rho=np.array([file.rho[:-1] for file in files]),
        z=HARTREE_BOHR * (charge[:, None, :-1] * charge[None, :, :-1]),
    )


class _Funcfl(NamedTuple):
    """Contents of a funcfl file."""

    comment: str
    head: str
    drho: float
    dr: float
    cutoff: float
    F: Floats
    charge: Floats
    rho: Floats


def _read_funcfl(path: Path) -> _Funcfl:
    lines = path.read_text(errors="replace").splitlines()
    try:
        nrho, drho, nr, dr, cutoff = _sizes(lines[2])
        words = _Words(lines[3:])
        F, charge, rho = words.numbers(nrho), words.numbers(nr), words.numbers(nr)
        words.end()
    except (IndexError, ValueError) as error:
        raise BackendError(f"{path}: is no potential file of pair_style eam: {error}") from None
    head = " ".join(lines[1].split()[:4])
    return _Funcfl(lines[0], head, drho, dr, cutoff, F, charge, rho)


def write_setfl(tables: Tables, path: Path) -> None:
    """Write a setfl file, with numbers that are read back exactly."""
    n = len(tables.names)
    rows = [
        tables.comment,
        "Made by gimpmd: the sites of elements whose names end with 0 are off",
        "",
        f"{n} {' '.join(tables.names)}",
        f"{tables.F.shape[1]} {tables.drho!r} {tables.z.shape[2]} {tables.dr!r} {tables.cutoff!r}",
    ]
    for head, F, rho in zip(tables.heads, tables.F, tables.rho, strict=True):
        rows += [
            head,
            *_lines(F),
            *(line for table in np.atleast_2d(rho) for line in _lines(table)),
        ]
    for i in range(n):
        for j in range(i + 1):
            rows += _lines(tables.z[i, j])
    path.write_text("\n".join(rows) + "\n")


def _sizes(line: str) -> tuple[int, float, int, float, float]:
    nrho, drho, nr, dr, cutoff = line.split()[:5]
    return int(nrho), float(drho), int(nr), float(dr), float(cutoff)


def _lines(values: Floats) -> list[str]:
    """Numbers, five on a line."""
    words = [repr(value) for value in values.tolist()]
    return [" ".join(words[k : k + 5]) for k in range(0, len(words), 5)]


class _Words:
    """Words of a table, one after another."""

    def __init__(self, lines: list[str]) -> None:
        self._words = " ".join(line.split("#")[0] for line in lines).split()
        self._next = 0

    def take(self, count: int) -> list[str]:
        words = self._words[self._next : self._next + count]
        if len(words) < count:
            raise ValueError(f"it ends {count - len(words)} numbers too early")
        self._next += count
        return words

    def numbers(self, count: int) -> Floats:
        return np.array([float(word.replace("D", "E")) for word in self.take(count)])

    def end(self) -> None:
        left = len(self._words) - self._next
        if left:
            raise ValueError(f"{left} numbers follow its last table")
