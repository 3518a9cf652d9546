"""Broken bonds near the planes: how a rank reports that a defect has reached the interface."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec


class BrokenBonds(msgspec.Struct, frozen=True, kw_only=True):
    """Bonds between nearest neighbours near the planes that are broken, at one step.

    Attributes
    ----------
    count : number of broken bonds.
    stretch : length of the longest one over its length at rest; 0 if there is none.
    place : present position of its middle (length), one coordinate for each axis; null: none.
    """

    count: int
    stretch: float = 0.0
    place: tuple[float, ...] | None = None


def total(ranks: Sequence[BrokenBonds | None]) -> BrokenBonds | None:
    """Sum the counts of the ranks of a side, with the place of the longest bond of all.

    Returns
    -------
    BrokenBonds or None
        None if no rank watches bonds.
    """
    known = [bonds for bonds in ranks if bonds is not None]
    if not known:
        return None
    longest = max(known, key=lambda bonds: bonds.stretch)
    count = sum(bonds.count for bonds in known)
    return BrokenBonds(count=count, stretch=longest.stretch, place=longest.place)


def components(bonds: BrokenBonds, dim: int) -> dict[str, float]:
    """Return the values of the data sets of ``run.h5``; see `fields.BOND_FIELDS`."""
    place = bonds.place or (math.nan,) * dim
    at = {f"broken_at_{axis}": x for axis, x in zip("xyz", place, strict=False)}
    return {"broken_bonds": bonds.count, **at}


def warning(time: float, place: Sequence[float]) -> str:
    """Tell the user that a defect has reached the planes.

    Parameters
    ----------
    time : float
        When the first broken bond was found.
    place : sequence of float
        Where.
    """
    where = ", ".join(f"{x:.5g}" for x in place)
    return (
        f"a defect of the crystal has reached the interface at t = {time:.6g}, near ({where}): "
        "bonds between neighbouring atoms are broken there, but the continuum beyond remains a "
        "perfect crystal, so the results are not reliable from here on; move the faces of the MD "
        "region further from the defect"
    )
