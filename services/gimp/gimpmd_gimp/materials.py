"""Constitutive laws. Strain and stress hold xx, yy and (engineering) shear."""

from __future__ import annotations

from dataclasses import dataclass

from numba import njit

from gimpmd_schemas.grid import Floats


@dataclass(frozen=True)
class LinearElastic:
    """Isotropic linear elasticity in plane strain; moduli in mechanical units."""

    lame: float
    shear: float

    def stress(self, strain: Floats, out: Floats) -> None:
        """Stress of every point, shape ``(n, 3)``, written to ``out``."""
        _hooke(strain, self.lame, self.shear, out)


@njit(cache=True)
def _hooke(strain: Floats, lame: float, shear: float, out: Floats) -> None:
    for p in range(strain.shape[0]):
        trace = lame * (strain[p, 0] + strain[p, 1])
        out[p, 0] = trace + 2.0 * shear * strain[p, 0]
        out[p, 1] = trace + 2.0 * shear * strain[p, 1]
        out[p, 2] = shear * strain[p, 2]
