"""Material points: a structure of arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.grid import BackgroundGrid, Bools, Floats


@dataclass
class MaterialPoints:
    """State of ``n`` material points; positions in length units, stress in mechanical units.

    Attributes
    ----------
    reference, x, v : ndarray, shape ``(n, 2)``
        Reference position X, position and velocity.
    a : ndarray, shape ``(n, 2)``
        Acceleration of the last step.
    mass, volume : ndarray, shape ``(n,)``
        Volume is area in two dimensions.
    half : ndarray, shape ``(n, 2)``
        Half edge lengths in cells, l / h of paper Eq. 12.
    strain : ndarray, shape ``(n, 3)``
        xx, yy and engineering shear.
    """

    reference: Floats
    x: Floats
    v: Floats
    a: Floats
    mass: Floats
    volume: Floats
    half: Floats
    strain: Floats

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.x.shape[0])


def fill_domain(grid: BackgroundGrid, per_cell: int, density: float) -> MaterialPoints:
    """Material points that tile the domain, ``per_cell`` along each direction of a cell."""
    edge = grid.cell / per_cell
    axes = [grid.origin[a] + edge * (np.arange(grid.cells[a] * per_cell) + 0.5) for a in range(2)]
    x, y = np.meshgrid(*axes, indexing="ij")
    reference = np.stack([x.ravel(), y.ravel()], axis=1)
    n = reference.shape[0]
    volume = np.full(n, edge * edge)
    return MaterialPoints(
        reference=reference,
        x=reference.copy(),
        v=np.zeros((n, 2)),
        a=np.zeros((n, 2)),
        mass=density * volume,
        volume=volume,
        half=np.full((n, 2), 0.5 / per_cell),
        strain=np.zeros((n, 3)),
    )


def keep(points: MaterialPoints, mask: Bools) -> MaterialPoints:
    """Points where ``mask`` holds, in the same order."""
    return MaterialPoints(**{name: array[mask] for name, array in vars(points).items()})
