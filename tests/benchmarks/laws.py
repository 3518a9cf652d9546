"""Points per second that each constitutive law evaluates on one core: medians over repeats.

In two dimensions the Cauchy-Born laws are measured with the Lennard-Jones crystal's number of terms
(polynomial of degree 6, odd powers of the shear zero; nine bonds, three of each length), within
their strain limit and with points beyond it. In three they are measured with the terms of a cubic
crystal, by the degree, and with 39 neighbours and tables of 10,000 points, as copper has them.
Half of the points of the plastic law have yielded.

With ``--steps``: processor time of whole steps in three dimensions, as in coupled runs, for each
point, and its ratio to that with the anisotropic law. The laws take turns.

    python -m tests.benchmarks.laws [--steps] [--points 100000] [--repeats 21]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
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
from gimpmd_gimp.laws.law import history_size, is_inelastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
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


def cubic(degree: int) -> CauchyBorn:
    """A crystal in space with mirror planes normal to the axes."""
    powers = exponents(6, degree)
    yz, xz, xy = powers[:, 3:].T
    even = ((xz + xy) % 2 == 0) & ((yz + xy) % 2 == 0)
    return CauchyBorn(1.0, np.where(even, 1.0, 0.0), 0.5, dimension=3)


def atoms() -> EmbeddedSum:
    """Copper's number of neighbours; values in the tables do not affect the speed."""
    vectors = np.random.default_rng(1).uniform(0.4, 0.5, (39, 3))
    table = (np.zeros((10_000, 4)), 1e-3)  # no forces
    return EmbeddedSum(1.0, isotropic(1.0, 1.0, 3), 1.0, vectors, 9.0, table, table, table)


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
    else:
        found |= {f"Cauchy-Born, degree {k}": cubic(k) for k in range(3, 7)}
        found["embedded atoms"] = atoms()
    return found


def rate(work: Callable[..., None], F: np.ndarray, *others: np.ndarray, repeats: int) -> float:
    """Million points per second, without the first call, which compiles."""
    order, seconds = np.arange(len(F)), []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work(order, 0, len(F), F, *others)
        seconds.append(time.perf_counter() - start)
    return len(F) / statistics.median(seconds[1:]) / 1e6


def solver(law: Law, points: int) -> Solver:
    """A cube with a smooth velocity field, eight points to a cell."""
    cells = round(points ** (1 / 3) / 2)
    mesh = Mesh(Hierarchy((0.0,) * 3, 1.0 / cells, (cells,) * 3, (False,) * 3))
    material = fill(mesh, 2, 1.0)
    material.v[:] = 1e-3 * material.x
    method = Method(integrator="musl", configuration="reference")
    return Solver(mesh, material, law, method, 0.01 / cells)


def steps(points: int, repeats: int) -> None:
    """Print what a step takes with each law, and the ratio to the anisotropic one."""
    names = ("anisotropic", "Cauchy-Born", "embedded")
    found = {name: law for name, law in laws(3).items() if name.startswith(names)}
    solvers = {name: solver(law, points) for name, law in found.items()}
    seconds: dict[str, list[float]] = {name: [] for name in solvers}
    for _ in range(repeats + 1):
        for name, one in solvers.items():
            start = time.process_time()
            one.step()
            seconds[name].append((time.process_time() - start) / one.points.count)
    each = {name: statistics.median(taken[1:]) for name, taken in seconds.items()}
    print("law                    ns per point and step   ratio")
    for name, taken in each.items():
        print(f"{name:22} {1e9 * taken:21.0f} {taken / each['anisotropic']:7.2f}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=21)
    parser.add_argument("--steps", action="store_true")
    options = parser.parse_args()
    if options.steps:
        steps(options.points, options.repeats)
        return
    print("law                    d   stress   energy   (million points/s)")
    for d in (2, 3):
        F = np.eye(d) + 0.01 * np.random.default_rng(0).standard_normal((options.points, d, d))
        for name, law in laws(d).items():
            history = np.zeros((options.points, history_size(law)))
            if is_inelastic(law):
                law.update(np.arange(options.points), 0, options.points, F, history)
            stress = rate(law.stress, F, history, np.empty_like(F), repeats=options.repeats)
            energy = rate(law.energy, F, history, np.empty(len(F)), repeats=options.repeats)
            print(f"{name:22} {d} {stress:8.0f} {energy:8.0f}")


if __name__ == "__main__":
    main()
