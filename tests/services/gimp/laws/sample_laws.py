"""Laws without symmetry, deformation gradients, and evaluation of a law at them."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.laws import (
    AnisotropicElastic,
    CauchyBorn,
    EmbeddedSum,
    J2Plasticity,
    LatticeSum,
    Law,
    LinearElastic,
    NeoHookean,
)
from gimpmd_gimp.laws.law import VOIGT, history_size
from gimpmd_schemas.mechanics.hyperelastic import exponents
from gimpmd_schemas.mechanics.splines import cubics

LAME, SHEAR, DENSITY = 2.3, 1.7, 0.9


def isotropic(d: int, lame: float = LAME, shear: float = SHEAR) -> np.ndarray:
    """Stiffness in Voigt order."""
    C = np.diag([2.0 * shear] * d + [shear] * (len(VOIGT[d]) - d))
    C[:d, :d] += lame
    return C


def any_stiffness(d: int) -> np.ndarray:
    """Positive definite stiffness without symmetry."""
    n = len(VOIGT[d])
    A = np.random.default_rng(d).standard_normal((n, n))
    return A @ A.T + n * np.eye(n)


def crystal(d: int, degree: int = 4, rest: np.ndarray | None = None) -> CauchyBorn:
    """Crystal without symmetry; about half of the strains of `gradients` exceed its limit."""
    C, powers = any_stiffness(d), exponents(len(VOIGT[d]), degree)
    coefficients = np.random.default_rng(4).uniform(-1, 1, len(powers))
    for n, power in enumerate(powers[powers.sum(axis=1) == 2]):
        v, w = np.repeat(np.arange(len(C)), power)
        coefficients[n] = C[v, w] if v != w else 0.5 * C[v, v]
    return CauchyBorn(DENSITY, coefficients, strain_limit=0.12, dimension=d, rest=rest)


def stress_at_rest(d: int) -> np.ndarray:
    """Stress without symmetry, in Voigt order."""
    return np.linspace(-0.2, 0.3, len(VOIGT[d]))


BONDS = np.array([[1.0, 0.1], [0.4, 1.1], [-0.7, 0.9], [1.6, 1.3]])


def bonded(limit: float = 0.12) -> LatticeSum:
    """Crystal under stress at rest, whose bonds have no symmetry and differ from each other.

    About half of the strains of `gradients` exceed the limit of one of the bonds.
    """
    energy = [[0.3, 4.0, -9.0], [-0.2, 3.0, 1.0, 8.0, -20.0], [0.1, 2.5], [-0.05, 0.4, -1.0, 2.0]]
    return LatticeSum(DENSITY, 1.3, BONDS, energy, limit)


def embedded(thermal: np.ndarray | None = None) -> EmbeddedSum:
    """Embedded atoms under stress at rest, whose bonds have no symmetry."""
    vectors = np.array(
        [[1.0, 0.1, 0.2], [0.1, 1.1, -0.3], [0.4, -0.5, 0.9], [-0.7, 0.6, 0.5], [1.1, 0.8, -0.2]]
    )
    step = 1e-3
    r, around = step * np.arange(2500), 2.0 * step * np.arange(5000)
    pair, cloud, energy = r * 6.0 * (r - 1.15) ** 2, np.exp(-r), -3.0 * np.sqrt(0.3 + around)
    tables = ((pair, step), (cloud, step), (energy, 2.0 * step))
    cubic = [(cubics(values), size) for values, size in tables]
    return EmbeddedSum(DENSITY, any_stiffness(3), 0.9, vectors, 2.4, *cubic, thermal)


def plastic(d: int, hardening: float = 0.3) -> J2Plasticity:
    """Law that yields at a shear strain of about 1 %."""
    return J2Plasticity(DENSITY, LAME, SHEAR, 0.03, hardening, d)


def laws(d: int) -> list[Law]:
    """One of each law that there is in d dimensions."""
    return [
        LinearElastic(DENSITY, LAME, SHEAR),
        NeoHookean(DENSITY, LAME, SHEAR),
        AnisotropicElastic(DENSITY, any_stiffness(d)),
        plastic(d),
        *([crystal(d)] if d > 1 else []),
        *([bonded()] if d == 2 else [embedded()] if d == 3 else []),
    ]


def gradients(d: int, n: int = 20, size: float = 0.1) -> np.ndarray:
    """Random deformation gradients, shape ``(n, d, d)``."""
    return np.eye(d) + size * np.random.default_rng(7).uniform(-1, 1, (n, d, d))


def at_rest(law: Law, F: np.ndarray) -> np.ndarray:
    """History variables at the start of a run, one row for each F."""
    return np.zeros((len(F), history_size(law)))


def stress(law: Law, F: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
    """Kirchhoff stress, with history variables at rest if there are none given."""
    out, history = np.full_like(F, np.nan), at_rest(law, F) if history is None else history
    law.stress(np.arange(len(F)), 0, len(F), F, history, out)
    return out


def energy(law: Law, F: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
    """Stored energy, with history variables at rest if there are none given."""
    out, history = np.full(len(F), np.nan), at_rest(law, F) if history is None else history
    law.energy(np.arange(len(F)), 0, len(F), F, history, out)
    return out
