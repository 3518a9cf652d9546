"""Whether the atoms near the interface of the force scheme are the crystal that the case tells of.

The continuum knows the bonds between free atoms and ghosts from the lattice alone, so every site
that such a bond can reach must hold an atom, and every atom there must sit on a site.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gimpmd_md.engines.lammps.script import extent
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Case, Crystal
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.planes import Interface, interfaces_of

OFF_SITE = 1e-4
"""How far an atom may be from its site, in lengths of the first primitive vector."""


def check_crystal(case: Case, cutoff: float, x: Floats, comm: Any) -> None:
    """Compare atoms and lattice within the cutoff on either side of the planes; collective.

    Parameters
    ----------
    case : Case
        With its crystal and planes found.
    cutoff : float
        Range of the potential.
    x : ndarray, shape ``(n, 2)``
        Positions of this rank's atoms, as the script of the case made them.
    comm : mpi4py communicator

    Raises
    ------
    BackendError
        Ghosts are not as deep as the potential reaches, or an atom or a site is on its own.
    """
    crystal = case.coupling.crystal
    if crystal is None:
        raise ValueError("the crystal at the interface has not been found yet")
    for key, interface in zip(case.coupling.each_planes(), interfaces_of(case), strict=True):
        _check_depth(key, interface, cutoff)
        _check_region(case, crystal, interface, cutoff, x, comm)


def _check_region(
    case: Case, crystal: Crystal, interface: Interface, cutoff: float, x: Floats, comm: Any
) -> None:
    """The same of one MD region."""
    script = case.atoms.input
    way_out = "the force scheme needs a perfect crystal there; else use coupling.scheme: velocity"
    slack = OFF_SITE * math.hypot(*crystal.vectors[0])
    x = _folded(case, x[_in_region(interface, x, slack)], slack)
    numbers = _numbers(crystal, x)
    sites = _sites(crystal, numbers)
    near = _near(interface, cutoff, sites)
    off = near & (np.hypot(*(x - sites).T) > slack)
    strays = np.concatenate(comm.allgather(x[off]))
    if len(strays):
        raise BackendError(
            f"{script}: the atom at ({strays[0, 0]:.6g}, {strays[0, 1]:.6g}), near the planes that "
            f"part atoms and continuum, sits on no site of the lattice ({len(strays)} such); "
            f"{way_out}"
        )
    held = np.concatenate(comm.allgather(numbers[near]))
    wanted = _numbers_within(crystal, _holding(case, interface, x, comm, slack))
    wanted = wanted[_near(interface, cutoff, _sites(crystal, wanted))]
    missing = sorted({tuple(n) for n in wanted.tolist()} - {tuple(n) for n in held.tolist()})
    if missing:
        site = _sites(crystal, np.array(missing[:1]))[0]
        raise BackendError(
            f"{script}: no atom at ({site[0]:.6g}, {site[1]:.6g}), a site of the lattice near the "
            f"planes that part atoms and continuum ({len(missing)} such); {way_out}"
        )


def _check_depth(key: str, interface: Interface, cutoff: float) -> None:
    """Planes lie at least the cutoff inside their region."""
    for axis in range(2):
        for side, name in enumerate((("left", "right"), ("bottom", "top"))[axis]):
            plane, face = interface.planes[axis][side], interface.region[axis][side]
            depth = abs(plane - face)
            if depth < cutoff * (1.0 - 1e-9):
                raise BackendError(
                    f"{key}.{name}: {plane:g} is {depth:g} inside md.region, less than "
                    f"the range {cutoff:g} of the potential; move the region's face {face:g} "
                    f"outward by at least {cutoff - depth:g}"
                )


def _numbers(crystal: Crystal, x: Floats) -> Ints:
    """Integer coordinates of the sites next to positions, shape ``(n, 2)``."""
    # in skewed coordinates rounding finds the next site only for atoms near one: others are off
    return np.rint((x - np.array(crystal.origin)) @ _inverse(crystal)).astype(np.int64)


def _sites(crystal: Crystal, numbers: Ints) -> Floats:
    return np.array(crystal.origin) + numbers @ np.array(crystal.vectors)


def _inverse(crystal: Crystal) -> Floats:
    return np.linalg.inv(np.array(crystal.vectors))


def _near(interface: Interface, cutoff: float, x: Floats) -> Bools:
    """Within the cutoff of the planes, on either side."""
    around, deep = np.ones(len(x), np.bool_), np.ones(len(x), np.bool_)
    for axis, (low, high) in enumerate(interface.planes):
        around &= (x[:, axis] > low - cutoff) & (x[:, axis] < high + cutoff)
        deep &= (x[:, axis] > low + cutoff) & (x[:, axis] < high - cutoff)
    return around & ~deep


def _in_region(interface: Interface, x: Floats, slack: float) -> Bools:
    """Positions in the region of an interface, or within the slack of it."""
    low, high = np.array(interface.region).T
    inside: Bools = ((x >= low - slack) & (x <= high + slack)).all(axis=1)
    return inside


def _folded(case: Case, x: Floats, slack: float) -> Floats:
    """Positions with those at the upper end of a period, or within the slack, at its lower end."""
    x = x.copy()
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            x[x[:, axis] >= high - slack, axis] -= high - low
    return x


def _holding(
    case: Case, interface: Interface, x: Floats, comm: Any, slack: float
) -> list[tuple[float, float]]:
    """Box of all sites that must hold atoms: to the rim's outermost atoms, or a whole period.

    At an interface the box ends with the region.
    """
    lowest, highest = extent(comm, np.array([x.min(0, initial=np.inf), x.max(0, initial=-np.inf)]))
    box = []
    for axis, (low, high) in enumerate(interface.region):
        if case.domain.periodic[axis]:
            box.append((low - slack, high - slack))
            continue
        plane = interface.planes[axis]
        box.append(
            (
                low if np.isfinite(plane[0]) else lowest[axis] - slack,
                high if np.isfinite(plane[1]) else highest[axis] + slack,
            )
        )
    return box


def _numbers_within(crystal: Crystal, box: list[tuple[float, float]]) -> Ints:
    """Integer coordinates of all sites in a half-open box, shape ``(n, 2)``."""
    corners = np.array([(a, b) for a in box[0] for b in box[1]])
    ends = (corners - np.array(crystal.origin)) @ _inverse(crystal)
    low, high = np.floor(ends.min(0)).astype(int), np.ceil(ends.max(0)).astype(int)
    axes = [np.arange(low[k], high[k] + 1) for k in range(2)]
    numbers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    x = _sites(crystal, numbers)
    inside = np.ones(len(x), np.bool_)
    for axis, (start, end) in enumerate(box):
        inside &= (x[:, axis] >= start) & (x[:, axis] < end)
    return numbers[inside].astype(np.int64)
