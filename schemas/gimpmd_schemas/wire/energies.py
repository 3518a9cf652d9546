"""The conserved quantities of a rank or of a side, and their sums."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.wire.fields import ENERGY_FIELDS


class Energies(msgspec.Struct, frozen=True, kw_only=True):
    """Mass, momentum and energies of one rank, or of one side of the run, at one step.

    Attributes
    ----------
    kinetic : kinetic energy (energy units of the unit style, as all energies here).
    potential : potential energy relative to the reference state, of what lies on this side of
        the plane that separates the energies of the two sides.
    external_work : work of tractions and prescribed velocities since the start.
    fix_work : work of the user's own fixes in the MD code since the start, heat of a thermostat
        included.
    interface_work : work that the other side has done on this side since the start.
    dissipated : energy turned into heat by friction, filter or absorber since the start.
    mass : mass.
    momentum : linear momentum (mass length / time), one component for each axis.
    """

    kinetic: float
    potential: float
    external_work: float
    fix_work: float = 0.0
    interface_work: float
    dissipated: float
    mass: float
    momentum: tuple[float, ...]


SCALARS = tuple(field.name for field in ENERGY_FIELDS if field.rank == 0)
"""Names of the quantities with one value; momentum has one for each axis."""


def total(ranks: Sequence[Energies | None]) -> Energies | None:
    """Sum the energies of all ranks of a side.

    The sums are exact and then rounded once, so they do not depend on the order of the ranks.

    Parameters
    ----------
    ranks : sequence of Energies or None
        What each rank reports. None stands for a step without energies.

    Returns
    -------
    Energies or None
        None if a rank has no energies at this step.
    """
    known = [energies for energies in ranks if energies is not None]
    if len(known) < len(ranks):
        return None
    scalars = {name: math.fsum(getattr(e, name) for e in known) for name in SCALARS}
    momentum = tuple(map(math.fsum, zip(*(e.momentum for e in known), strict=True)))
    return Energies(**scalars, momentum=momentum)


def components(energies: Energies | None, dim: int) -> dict[str, float]:
    """Return the energies as one number for each data set of ``run.h5``.

    Parameters
    ----------
    energies : Energies or None
        None gives NaN for every quantity.
    dim : int
        Number of dimensions.

    Returns
    -------
    dict of str to float
        With ``momentum_x``, ``momentum_y`` and, in three dimensions, ``momentum_z``.
    """
    names = [name for field in ENERGY_FIELDS for name in field.components(dim)]
    if energies is None:
        return dict.fromkeys(names, math.nan)
    values = [*(getattr(energies, name) for name in SCALARS), *energies.momentum]
    return dict(zip(names, values, strict=True))


def from_components(values: Mapping[str, float]) -> Energies | None:
    """The inverse of `components`; None if the values are NaN."""
    if math.isnan(values["kinetic"]):
        return None
    scalars = {name: values[name] for name in SCALARS}
    momentum = (values.get(f"momentum_{axis}") for axis in "xyz")
    return Energies(**scalars, momentum=tuple(p for p in momentum if p is not None))


def to_array(energies: Energies) -> Floats:
    """Scalars in the order of `SCALARS`, then the momentum, shape ``(7 + d,)``."""
    return np.array([*(getattr(energies, name) for name in SCALARS), *energies.momentum])


def from_array(values: Floats) -> Energies:
    """The inverse of `to_array`."""
    scalars, momentum = values[: len(SCALARS)].tolist(), values[len(SCALARS) :].tolist()
    return Energies(**dict(zip(SCALARS, scalars, strict=True)), momentum=tuple(momentum))
