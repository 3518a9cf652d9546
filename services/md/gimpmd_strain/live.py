"""Strain of the atoms of a running LAMMPS, through its library interface."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.background import increment_gradient, total_gradient
from gimpmd_strain.box import Box, Configuration
from gimpmd_strain.measures import MEASURES, components, infinitesimal
from gimpmd_strain.settings import Settings
from gimpmd_strain.virial import (
    Neighbours,
    find_neighbours,
    nearest_distance,
    virial_strain,
)

_NUMBERS = count(1)
"""Gives each ``LiveStrain`` its own names in LAMMPS, which are the same on all ranks."""


class LiveStrain:
    """Strain of all atoms relative to their positions now; call ``update`` during the run.

    It works on any number of ranks. Data that must move with an atom from rank to rank are
    per-atom properties of LAMMPS. Several objects may watch one instance of LAMMPS.

    Parameters
    ----------
    lammps : lammps.lammps
        Its atoms are in their undeformed state, after at least ``run 0``.
    settings : Settings

    Attributes
    ----------
    settings : Settings
        Settings with all lengths.
    dimension : int

    Raises
    ------
    InputError
        There are too few atoms, or a setting is not suitable for them.
    """

    def __init__(self, lammps: Any, settings: Settings) -> None:
        self._lammps = lammps
        self._name = f"gimpmd_strain_{next(_NUMBERS)}"
        self._comm = lammps.get_mpi_comm() or _alone()
        self.dimension = int(lammps.extract_setting("dimension"))
        lammps.command(f"compute {self._name} all property/atom xu yu zu")
        kept = " ".join(f"d2_{self._name}_{word}" for word in ("first 3", "last 3", "sum 6"))
        lammps.command(f"fix {self._name} all property/atom {kept}")
        x = self._positions()
        self._view("first", 3)[:] = x
        self._view("last", 3)[:] = x
        self._start = self._last = self._box()
        self._all = self._everywhere(Configuration(self._start, self._flat(x)))
        distance = nearest_distance(self._all)
        self.settings = settings.resolved(distance)
        self._neighbours: tuple[Ints, Neighbours] | None = None

    def update(self) -> Floats:
        """Compute the present strain of the atoms of this rank; collective.

        The method ``incremental`` adds the strain since the last update. The time between updates
        is therefore its time step.

        Returns
        -------
        ndarray, shape ``(nlocal, 3)`` or ``(nlocal, 6)``
            Components in the order of ``measures.COMPONENTS``, atoms in the present order of LAMMPS
            (``extract_atom("id")``). NaN where the strain is undefined.

        Raises
        ------
        InputError
            Atoms were lost or added, or they are too far apart for a grid of this cell.
        """
        atoms = int(self._lammps.get_natoms())
        if atoms != len(self._all.x):
            message = f"the reference has {len(self._all.x)}, and there are {atoms} now"
            hint = "make a new LiveStrain"
            raise InputError("atomic strain", [Problem("atoms", None, message, hint)])
        x = self._positions()
        box = self._box().continued(self._last)
        now = Configuration(box, self._flat(x))
        first = Configuration(self._start, self._flat(self._view("first", 3)))
        if self.settings.method == "virial":
            strain = components(self._virial(first, now))
        elif self.settings.method == "total":
            H = total_gradient(first, now, self._masses(), self.settings.grid(), self._comm)
            strain = components(MEASURES[self.settings.measure](H))
        else:
            before = Configuration(self._last, self._flat(self._view("last", 3)))
            grid = self.settings.grid()
            H = increment_gradient(before, now, self._masses(), grid, self._comm)
            sum_ = self._view("sum", 6)[:, : 3 * (self.dimension - 1)]
            sum_ += components(infinitesimal(H))
            strain = sum_.copy()
        self._view("last", 3)[:] = x
        self._last = box
        return strain

    def close(self) -> None:
        """Remove everything from LAMMPS that this object has added."""
        self._lammps.command(f"unfix {self._name}")
        self._lammps.command(f"uncompute {self._name}")

    def _virial(self, first: Configuration, now: Configuration) -> Floats:
        """Virial strain; all ranks get all positions, since neighbours may be on any rank."""
        assert self.settings.cutoff is not None
        own = self._own_ids()
        if self._neighbours is None or not np.array_equal(self._neighbours[0], own):
            found = find_neighbours(first.x, self._all, self.settings.cutoff)
            self._neighbours = own, found
        return virial_strain(self._neighbours[1], now.x, self._everywhere(now))

    def _everywhere(self, own: Configuration) -> Configuration:
        """Gather the atoms of all ranks, in the order of their ids."""
        ids = np.concatenate(self._comm.allgather(self._own_ids()))
        x = np.concatenate(self._comm.allgather(own.x))
        return Configuration(own.box, x[np.argsort(ids)])

    def _box(self) -> Box:
        low, high, xy, yz, xz, periodic, _ = self._lammps.extract_box()
        return Box.of_lammps(
            np.array(low),
            np.array(high),
            np.array([xy, xz, yz]),
            np.array(periodic, dtype=bool),
            self.dimension,
        )

    def _count(self) -> int:
        return int(self._lammps.extract_setting("nlocal"))

    def _own_ids(self) -> Ints:
        if self._count() == 0:
            return np.zeros(0, np.int64)
        return self._lammps.numpy.extract_atom("id")[: self._count()].astype(np.int64)

    def _positions(self) -> Floats:
        """Unwrapped positions of the local atoms, shape ``(nlocal, 3)``."""
        if self._count() == 0:
            return np.zeros((0, 3))
        return self._lammps.numpy.extract_compute(self._name, 1, 2)[: self._count()].copy()

    def _masses(self) -> Floats:
        if self._count() == 0:
            return np.zeros(0)
        numpy = self._lammps.numpy
        by_type = numpy.extract_atom("mass")
        if by_type is not None:
            return by_type[numpy.extract_atom("type")[: self._count()]]
        return numpy.extract_atom("rmass")[: self._count()].copy()

    def _view(self, name: str, columns: int) -> Floats:
        """Writable view of a per-atom property."""
        if self._count() == 0:
            return np.zeros((0, columns))
        return self._lammps.numpy.extract_atom(f"d2_{self._name}_{name}")[: self._count()]

    def _flat(self, x: Floats) -> Floats:
        """Keep the first two or three axes."""
        return np.ascontiguousarray(x[:, : self.dimension])


def _alone() -> Any:
    from mpi4py import MPI

    return MPI.COMM_SELF
