"""Whether the atoms near the interface of the force scheme are the crystal of the case.

The continuum knows the bonds between free atoms and ghosts only from the lattice. So every site
that such a bond can reach must hold an atom, and every atom there must be at a site.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_md.sums import extent
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import FACES, Crystal
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.planes import Interface

OFF_SITE = 1e-4
"""How far an atom may be from its site, in lengths of the first primitive vector."""


def check_crystal(plan: Plan, cutoff: float, x: Floats, comm: Any) -> None:
    """Compare atoms and lattice within the cutoff on either side of the planes; collective.

    Parameters
    ----------
    plan : Plan
        Of a run by the force scheme.
    cutoff : float
        Range of the potential.
    x : ndarray, shape ``(n, d)``
        Positions of this rank's atoms, as the script of the case made them.
    comm : mpi4py communicator

    Raises
    ------
    BackendError
        The ghosts are not as deep as the potential reaches, an atom is at no site, or a site holds
        no atom.
    """
    crystal, interfaces = plan.coupled.crystal, plan.coupled.interfaces
    if crystal is None:
        raise ValueError("the crystal at the interface has not been found yet")
    for number, interface in enumerate(interfaces):
        key = "coupling.planes" if len(interfaces) == 1 else f"coupling.planes[{number}]"
        _check_depth(key, interface, cutoff)
        _check_region(plan, crystal, interface, cutoff, x, comm)


def _check_region(
    plan: Plan, crystal: Crystal, interface: Interface, cutoff: float, x: Floats, comm: Any
) -> None:
    """Compare atoms and lattice of one MD region."""
    script = plan.atoms.input
    way_out = "the force scheme needs a perfect crystal there; else use coupling.scheme: velocity"
    slack = OFF_SITE * float(np.linalg.norm(crystal.vectors[0]))
    x = _folded(plan, x[_in_region(interface, x, slack)], slack)
    numbers = _numbers(crystal, x)
    sites = _sites(crystal, numbers)
    near = _near(interface, cutoff, sites)
    off = near & (np.linalg.norm(x - sites, axis=1) > slack)
    strays = np.concatenate(comm.allgather(x[off]))
    if len(strays):
        raise BackendError(
            f"{script}: the atom at {where(strays[0])}, near the planes between atoms and "
            f"continuum, is not at a lattice site ({len(strays)} such atoms); {way_out}"
        )
    held = np.concatenate(comm.allgather(numbers[near]))
    needed = _numbers_within(crystal, _box_of_sites(plan, interface, x, comm, slack))
    needed = needed[_near(interface, cutoff, _sites(crystal, needed))]
    missing = sorted({tuple(n) for n in needed.tolist()} - {tuple(n) for n in held.tolist()})
    if missing:
        site = _sites(crystal, np.array(missing[:1]))[0]
        raise BackendError(
            f"{script}: no atom at {where(site)}, a site of the lattice near the planes between "
            f"atoms and continuum ({len(missing)} such sites); {way_out}"
        )


def where(x: Floats) -> str:
    """A position ``(d,)`` in messages."""
    return f"({', '.join(f'{c:.6g}' for c in x)})"


def _check_depth(key: str, interface: Interface, cutoff: float) -> None:
    """Check that planes lie at least one cutoff inside their region."""
    for axis, planes in enumerate(interface.planes):
        for side, plane in enumerate(planes):
            name, face = FACES[2 * axis + side], interface.region[axis][side]
            depth = abs(plane - face)
            if depth < cutoff * (1.0 - 1e-9):
                raise BackendError(
                    f"{key}.{name}: {plane:g} is {depth:g} inside md.region, less than "
                    f"the range {cutoff:g} of the potential; move the region's face {face:g} "
                    f"outward by at least {cutoff - depth:g}"
                )


def _numbers(crystal: Crystal, x: Floats) -> Ints:
    """Integer coordinates of the sites nearest to positions, shape ``(n, d)``."""
    # with skewed vectors rounding finds the nearest site only of atoms near one; others fail anyway
    return np.rint((x - np.array(crystal.origin)) @ _inverse(crystal)).astype(np.int64)


def _sites(crystal: Crystal, numbers: Ints) -> Floats:
    return np.array(crystal.origin) + numbers @ np.array(crystal.vectors)


def _inverse(crystal: Crystal) -> Floats:
    return np.linalg.inv(np.array(crystal.vectors))


def _near(interface: Interface, cutoff: float, x: Floats) -> Bools:
    """Which positions are within the cutoff of the planes, on either side."""
    around, deep = np.ones(len(x), np.bool_), np.ones(len(x), np.bool_)
    for axis, (low, high) in enumerate(interface.planes):
        around &= (x[:, axis] > low - cutoff) & (x[:, axis] < high + cutoff)
        deep &= (x[:, axis] > low + cutoff) & (x[:, axis] < high - cutoff)
    return around & ~deep


def _in_region(interface: Interface, x: Floats, slack: float) -> Bools:
    """Which positions are in the region of an interface, or closer to it than the slack."""
    low, high = np.array(interface.region).T
    inside: Bools = ((x >= low - slack) & (x <= high + slack)).all(axis=1)
    return inside


def _folded(plan: Plan, x: Floats, slack: float) -> Floats:
    """Move positions at the upper end of a periodic axis, or within the slack, by one period."""
    x = x.copy()
    for axis, (low, high) in enumerate(plan.domain.box):
        if plan.domain.periodic[axis]:
            x[x[:, axis] >= high - slack, axis] -= high - low
    return x


def _box_of_sites(
    plan: Plan, interface: Interface, x: Floats, comm: Any, slack: float
) -> list[tuple[float, float]]:
    """Box of all sites that must hold atoms.

    It ends with the region at an interface, and with the outermost atoms at the rim of the domain.
    Along a periodic axis it is one period.
    """
    lowest, highest = extent(comm, x)
    box = []
    for axis, (low, high) in enumerate(interface.region):
        if plan.domain.periodic[axis]:
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
    """Integer coordinates of all sites in a half-open box, shape ``(n, d)``."""
    corners = np.stack(np.meshgrid(*box, indexing="ij"), axis=-1).reshape(-1, len(box))
    ends = (corners - np.array(crystal.origin)) @ _inverse(crystal)
    low, high = np.floor(ends.min(0)).astype(int), np.ceil(ends.max(0)).astype(int)
    axes = [np.arange(start, end + 1) for start, end in zip(low, high, strict=True)]
    numbers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
    x = _sites(crystal, numbers)
    inside = np.ones(len(x), np.bool_)
    for axis, (start, end) in enumerate(box):
        inside &= (x[:, axis] >= start) & (x[:, axis] < end)
    return numbers[inside].astype(np.int64)
