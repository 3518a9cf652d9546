"""Anisotropic linear elasticity at small strains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimpmd_gimp.laws.law import (
    TRUSTED,
    VOIGT,
    History,
    LawMakers,
    by_dimension,
    fastest_wave,
    kernel,
)
from gimpmd_gimp.laws.thermal import stress_of_plan
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import Anisotropic
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True, eq=False)
class AnisotropicElastic:
    """``tau = C eps + rest`` in Voigt order, with ``eps = sym(F) - I`` and engineering shears.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    stiffness : ndarray, shape ``(m, m)``
        Symmetric stiffness C (mechanical units). In one dimension m = 1. In two dimensions m = 3,
        in the order xx, yy, xy. In three m = 6, in the order xx, yy, zz, yz, xz, xy.
    rest : ndarray, shape ``(m,)``, optional
        Stress at rest, such as the thermal stress (mechanical units); zero by default.

    Raises
    ------
    ValueError
        The stiffness has another shape, is not symmetric, or is not positive definite.
    """

    density: float
    stiffness: Floats
    rest: Floats | None = None

    name: ClassVar[str] = "anisotropic elastic"
    finite: ClassVar[bool] = False
    history: ClassVar[History] = ()

    def __post_init__(self) -> None:
        C = np.array(self.stiffness, dtype=float)
        if C.shape not in ((1, 1), (3, 3), (6, 6)):
            raise ValueError(f"the stiffness must be 3 x 3 or 6 x 6, not {C.shape}")
        if not np.allclose(C, C.T, rtol=0.0, atol=1e-9 * np.abs(C).max()):
            raise ValueError("the stiffness is not symmetric")
        C = 0.5 * (C + C.T)
        if np.linalg.eigvalsh(C)[0] <= 0.0:
            raise ValueError("the stiffness is not positive definite")
        C.flags.writeable = False
        object.__setattr__(self, "stiffness", C)
        rest = np.zeros(len(C)) if self.rest is None else np.array(self.rest, dtype=float)
        rest.flags.writeable = False
        object.__setattr__(self, "rest", rest)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        _STRESS[F.shape[1]](order, first, last, F, self.stiffness, self.rest, out)

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """``eps : C : eps / 2 + rest : eps``; see `Law`."""
        _ENERGY[F.shape[1]](order, first, last, F, self.stiffness, self.rest, out)

    def wave_speed(self) -> float:
        """Speed of the fastest wave, over all directions."""
        return fastest_wave(self.stiffness, self.density)

    @property
    def trusted_strain(self) -> float:
        """Strain up to which small strains are small; see `Law`."""
        return TRUSTED


def from_material(material: Anisotropic, plan: Plan) -> AnisotropicElastic:
    """Law of a material ``from: stiffness``."""
    unit = UNITS[plan.units].stress_to_mechanical(1.0)
    return AnisotropicElastic(material.density, unit * plan.stiffness(), stress_of_plan(plan))


MATERIALS: LawMakers = {Anisotropic: from_material}


@kernel
def _strain(F: Floats, p: int, i: int, j: int) -> float:
    """Normal strain, or engineering shear strain, of point p."""
    return F[p, i, i] - 1.0 if i == j else F[p, i, j] + F[p, j, i]


def _make_stress(d: int) -> Callable[..., None]:
    voigt = VOIGT[d]

    @kernel
    def stress(
        order: Ints, first: int, last: int, F: Floats, C: Floats, rest: Floats, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])  # unsigned: no test for indices from the end
            for v in range(len(voigt)):
                tau = rest[v]
                for w in range(len(voigt)):
                    tau += C[v, w] * _strain(F, p, voigt[w][0], voigt[w][1])
                out[p, voigt[v][0], voigt[v][1]] = tau
                out[p, voigt[v][1], voigt[v][0]] = tau

    return stress


def _make_energy(d: int) -> Callable[..., None]:
    voigt = VOIGT[d]

    @kernel
    def energy(
        order: Ints, first: int, last: int, F: Floats, C: Floats, rest: Floats, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])
            twice = 0.0
            for v in range(len(voigt)):
                tau = 2.0 * rest[v]
                for w in range(len(voigt)):
                    tau += C[v, w] * _strain(F, p, voigt[w][0], voigt[w][1])
                twice += tau * _strain(F, p, voigt[v][0], voigt[v][1])
            out[p] = 0.5 * twice

    return energy


_STRESS = by_dimension(_make_stress)
_ENERGY = by_dimension(_make_energy)
