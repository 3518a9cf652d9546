"""Strain tensors of a displacement gradient, and the order of their components."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from gimpmd_schemas.arrays import Floats

Measure = Literal["infinitesimal", "green", "almansi"]

COMPONENTS = {2: ("xx", "yy", "xy"), 3: ("xx", "yy", "zz", "xy", "xz", "yz")}
"""Order of the components by dimension; shear is that of the tensor, half the engineering shear."""


def infinitesimal(H: Floats) -> Floats:
    """Infinitesimal strain ``(H + H^T) / 2`` (paper Eq. 6), for small rotations; ``(n, d, d)``."""
    return 0.5 * (H + _transposed(H))


def green(H: Floats) -> Floats:
    """Green-Lagrange strain ``(F^T F - 1) / 2`` with ``F = 1 + H``."""
    return 0.5 * (H + _transposed(H) + _transposed(H) @ H)


def almansi(H: Floats) -> Floats:
    """Almansi (Eulerian) strain ``(1 - F^-T F^-1) / 2``, as in the virial formula (Eq. 4)."""
    one = np.eye(H.shape[1])
    F = np.where(np.isfinite(H), one + H, one)
    inverse = np.linalg.inv(F)
    strain = 0.5 * (one - _transposed(inverse) @ inverse)
    strain[~np.isfinite(H).all(axis=(1, 2))] = np.nan
    return strain


MEASURES: dict[Measure, Callable[[Floats], Floats]] = {
    "infinitesimal": infinitesimal,
    "green": green,
    "almansi": almansi,
}


def components(strain: Floats) -> Floats:
    """Components in the order of ``COMPONENTS``, shape ``(n, 3)`` or ``(n, 6)``."""
    d = strain.shape[1]
    rows, columns = ([0, 1, 0], [0, 1, 1]) if d == 2 else ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
    return strain[:, rows, columns]


def _transposed(H: Floats) -> Floats:
    return np.swapaxes(H, -1, -2)
