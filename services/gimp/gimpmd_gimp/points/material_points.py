"""Material points as a structure of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints

Configuration = Literal["current", "reference"]
"""Where points are on the background grid: at their current or at their reference positions."""


@dataclass
class MaterialPoints:
    """State of ``n`` material points in ``d`` dimensions (length units, mechanical units).

    Attributes
    ----------
    id : ndarray of int64, shape ``(n,)``
        Identifies a point, whichever rank holds it and wherever it is in the arrays.
    reference, x, v : ndarray, shape ``(n, d)``
        Reference position X, position (not wrapped across periodic faces) and velocity.
    dv : ndarray, shape ``(n, d)``
        Change of velocity in the last kick of the point's level.
    mass, volume : ndarray, shape ``(n,)``
        Mass and reference volume (area in two dimensions).
    half : ndarray, shape ``(n, d)``
        Half edge lengths at rest in cells of the point's level, l / h of paper Eq. 12.
    F : ndarray, shape ``(n, d, d)``
        Deformation gradient; ``F - I`` is the displacement gradient of small-strain laws.
    history : ndarray, shape ``(n, k)``
        History variables of the law, as ``Law.history`` names them; k is 0 for elastic laws.
    level : ndarray of int32, shape ``(n,)``
        Level of the background grid that the point belongs to.
    rate : ndarray of int32, shape ``(n,)``
        Level whose time step moves the point: its own, or the next finer one near that level.
    block : ndarray of int32, shape ``(n,)``
        Block of this rank's mesh that contains the point.
    flags : ndarray of int32, shape ``(n,)``
        One bit for each named group.
    """

    id: Ints
    reference: Floats
    x: Floats
    v: Floats
    dv: Floats
    mass: Floats
    volume: Floats
    half: Floats
    F: Floats
    history: Floats
    level: Int32s
    rate: Int32s
    block: Int32s
    flags: Int32s

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.x.shape[0])

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return int(self.x.shape[1])

    def on_grid(self, configuration: Configuration) -> Floats:
        """Positions of the points on the background grid, shape ``(n, d)``."""
        return self.x if configuration == "current" else self.reference

    @property
    def strain(self) -> Floats:
        """Small strain ``sym(F) - I`` in Voigt order with engineering shear, shape ``(n, ...)``.

        The order is xx; xx, yy, xy; or xx, yy, zz, yz, xz, xy.
        """
        normal = [self.F[:, k, k] - 1.0 for k in range(self.dim)]
        shear = [self.F[:, i, j] + self.F[:, j, i] for i, j in SHEAR[self.dim]]
        return np.stack(normal + shear, axis=1)


SHEAR: dict[int, tuple[tuple[int, int], ...]] = {
    1: (),
    2: ((0, 1),),
    3: ((1, 2), (0, 2), (0, 1)),
}
"""Index pairs of the shear components in Voigt order."""


def points_at_rest(
    reference: Floats,
    volume: Floats,
    density: float,
    half: Floats,
    level: Int32s,
    first_id: int = 0,
    history: int = 0,
) -> MaterialPoints:
    """Make points at their reference positions, undeformed and without velocity.

    Parameters
    ----------
    reference : ndarray, shape ``(n, d)``
    volume : ndarray, shape ``(n,)``
        Reference volume (area in two dimensions).
    density : float
        Mass per volume.
    half : ndarray, shape ``(n, d)``
        Half edge lengths in cells of the level.
    level : ndarray of int32, shape ``(n,)``
    first_id : int
        Id of the first point.
    history : int
        Number of columns of history variables, which are zero at rest (`law.history_size`).
    """
    n, d = reference.shape
    return MaterialPoints(
        id=first_id + np.arange(n, dtype=np.int64),
        reference=reference,
        x=reference.copy(),
        v=np.zeros((n, d)),
        dv=np.zeros((n, d)),
        mass=density * volume,
        volume=volume,
        half=half,
        F=np.tile(np.eye(d), (n, 1, 1)),
        history=np.zeros((n, history)),
        level=level.astype(np.int32),
        rate=level.astype(np.int32),
        block=np.zeros(n, dtype=np.int32),
        flags=np.zeros(n, dtype=np.int32),
    )


def take(points: MaterialPoints, chosen: Ints | Bools) -> MaterialPoints:
    """Copy the points that a mask or indices select, in that order."""
    return MaterialPoints(
        **{f.name: np.ascontiguousarray(getattr(points, f.name)[chosen]) for f in fields(points)}
    )


def join(parts: Sequence[MaterialPoints]) -> MaterialPoints:
    """Concatenate the points of all parts."""
    return MaterialPoints(
        **{
            f.name: np.concatenate([getattr(part, f.name) for part in parts])
            for f in fields(parts[0])
        }
    )
