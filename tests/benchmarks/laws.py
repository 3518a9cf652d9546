"""Points per second that each constitutive law evaluates on one core: medians over repeats.

The Cauchy-Born laws are measured with the Lennard-Jones crystal's number of terms (polynomial of
degree 6, odd powers of the shear zero; nine bonds, three of each length), within their strain limit
and with points beyond it. Half of the points of the plastic law have yielded.

    python -m tests.benchmarks.laws [--points 100000] [--repeats 21]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from gimpmd_gimp.laws import (
    AnisotropicElastic,
    CauchyBorn,
    J2Plasticity,
    LatticeSum,
    Law,
    LinearElastic,
    NeoHookean,
)
from gimpmd_gimp.laws.law import history_size, is_inelastic
from gimpmd_schemas.mechanics.elasticity import isotropic
from gimpmd_schemas.mechanics.hyperelastic import exponents


def crystal(limit: float) -> CauchyBorn:
    """A plane crystal with mirror lines along the axes."""
    powers = exponents(3, 6)
    return CauchyBorn(1.0, np.where(powers[:, 2] % 2 == 0, 1.0, 0.0), limit)


def bonds(limit: float) -> LatticeSum:
    """Nine bonds; their vectors and coefficients do not affect the speed."""
    vectors = np.random.default_rng(1).standard_normal((9, 2))
    energy = [[0.0, *[1.0] * (length - 1)] for length in (15, 13, 12) for _ in range(3)]
    return LatticeSum(1.0, 1.0, vectors, energy, limit)


def laws(d: int) -> dict[str, Law]:
    """The laws of a dimension by the names in the table."""
    found: dict[str, Law] = {
        "linear": LinearElastic(1.0, 1.0, 1.0),
        "neo-Hookean": NeoHookean(1.0, 1.0, 1.0),
        "anisotropic": AnisotropicElastic(1.0, isotropic(1.0, 1.0, d)),
        "J2 plasticity": J2Plasticity(1.0, 1.0, 1.0, 0.03, 0.1, d),
    }
    if d == 2:
        found["Cauchy-Born"] = crystal(0.5)
        found["Cauchy-Born, beyond"] = crystal(1e-3)
        found["lattice sum"] = bonds(0.5)
        found["lattice sum, beyond"] = bonds(1e-3)
    return found


def rate(work: Callable[..., None], F: np.ndarray, *others: np.ndarray, repeats: int) -> float:
    """Million points per second, without the first call, which compiles."""
    order, seconds = np.arange(len(F)), []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work(order, 0, len(F), F, *others)
        seconds.append(time.perf_counter() - start)
    return len(F) / statistics.median(seconds[1:]) / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=21)
    options = parser.parse_args()
    print("law                  d   stress   energy   (million points/s)")
    for d in (2, 3):
        F = np.eye(d) + 0.01 * np.random.default_rng(0).standard_normal((options.points, d, d))
        for name, law in laws(d).items():
            history = np.zeros((options.points, history_size(law)))
            if is_inelastic(law):
                law.update(np.arange(options.points), 0, options.points, F, history)
            stress = rate(law.stress, F, history, np.empty_like(F), repeats=options.repeats)
            energy = rate(law.energy, F, history, np.empty(len(F)), repeats=options.repeats)
            print(f"{name:20} {d} {stress:8.0f} {energy:8.0f}")


if __name__ == "__main__":
    main()
