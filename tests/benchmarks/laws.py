"""Points per second that each constitutive law serves on one core: medians over repeats.

The Cauchy-Born laws are measured with the Lennard-Jones crystal's number of terms (polynomial of
degree 6, odd powers of the shear zero; nine bonds, three of each length), within their reach and
with points beyond it.

    python tests/benchmarks/laws.py [--points 100000] [--repeats 21]
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
    LatticeSum,
    Law,
    LinearElastic,
    NeoHookean,
)
from gimpmd_schemas.mechanics.elasticity import isotropic
from gimpmd_schemas.mechanics.hyperelastic import exponents


def crystal(reach: float) -> CauchyBorn:
    """A plane crystal with mirror lines along the axes."""
    powers = exponents(3, 6)
    return CauchyBorn(1.0, np.where(powers[:, 2] % 2 == 0, 1.0, 0.0), reach)


def bonds(reach: float) -> LatticeSum:
    """Nine bonds; what their vectors and coefficients are does not matter to the speed."""
    vectors = np.random.default_rng(1).standard_normal((9, 2))
    energy = [[0.0, *[1.0] * (length - 1)] for length in (15, 13, 12) for _ in range(3)]
    return LatticeSum(1.0, 1.0, vectors, energy, reach)


def laws(d: int) -> dict[str, Law]:
    """The laws of a dimension by the names in the table."""
    found: dict[str, Law] = {
        "linear": LinearElastic(1.0, 1.0, 1.0),
        "neo-Hookean": NeoHookean(1.0, 1.0, 1.0),
        "anisotropic": AnisotropicElastic(1.0, isotropic(1.0, 1.0, d)),
    }
    if d == 2:
        found["Cauchy-Born"] = crystal(0.5)
        found["Cauchy-Born, beyond"] = crystal(1e-3)
        found["lattice sum"] = bonds(0.5)
        found["lattice sum, beyond"] = bonds(1e-3)
    return found


def rate(work: Callable[..., None], F: np.ndarray, out: np.ndarray, repeats: int) -> float:
    """Million points per second; the first call, which compiles, does not count."""
    order, seconds = np.arange(len(F)), []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work(order, 0, len(F), F, out)
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
            stress = rate(law.stress, F, np.empty_like(F), options.repeats)
            energy = rate(law.energy, F, np.empty(len(F)), options.repeats)
            print(f"{name:20} {d} {stress:8.0f} {energy:8.0f}")


if __name__ == "__main__":
    main()
