"""Thermal expansion: a warm strip with free ends, its atoms and its continuum, and atoms alone.

The strip repeats along y, so it expands along x alone. What the continuum should do follows from
lattice sums and lattice dynamics, what the atoms should do from LAMMPS alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq

from gimpmd_deploy.results.particles import Particles
from gimpmd_gimp.laws import thermal_stress
from tests.physics import lattice
from tests.physics.gimp.gates import Check
from tests.physics.interface.noise import warm_case
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import SCHEMES, SOURCE, SchemeName, coupled
from tests.physics.strips import H, Run, energies

TEMPERATURE, END = 0.05, 400.0

Read = Callable[[float], Particles]
"""Reads one side of a run at an output."""

EXCESS = 1.035
"""Kinetic energy at the start, over that which gives the temperature: nodes take a share."""

SETTLED = 0.1
"""Share of the run before strains are averaged."""

RIM = 1.5
"""Cells next to planes and ends in which they act."""

NODES = lattice.AREA / H**2
"""Freedoms of nodes over freedoms of atoms, 7 %: what vibrations of the grid add at equal T."""

DYNAMICS = "lattice dynamics: 1.3 % high at this T, noise 1 %"


def strain_at(temperature: float) -> float:
    """Strain along x of a strip without load whose width is fixed: ``S_xx(E) + S_thermal = 0``."""
    push = thermal_stress(*lattice.bonds(), lattice.AREA, temperature)[0]

    def stress(strain: float) -> float:
        F = np.diag([1.0 + strain, 1.0])
        _, tau = lattice.deform(F[None])
        return float(tau[0, 0, 0] / F[0, 0] ** 2 + push)

    return float(brentq(stress, 0.0, 0.02))


def expanding(scheme: SchemeName | Literal["sites"]) -> dict[str, Any]:
    """The warm strip, without the held ends, stretched from the start so that it rings little."""
    at_planes: SchemeName = "force" if scheme == "sites" else scheme
    case = coupled(warm_case(at_planes, EXCESS * TEMPERATURE, END), at_planes)
    case["coupling"]["scheme"] = scheme
    strain, middle = strain_at(TEMPERATURE), 0.5 * case["domain"]["box"][0][1]
    case["name"] = "expansion"
    case["boundary"] = {}
    case["time"]["md_steps"] = 8  # with 16 the energy of so large motions wanders by 1e-3
    case["continuum"]["temperature"] = TEMPERATURE
    case["initial"]["stretch"] = {"gradient": [[strain, 0.0], [0.0, 0.0]], "center": [middle, 0.0]}
    case["output"]["interval"] = 2.0
    return case


def mean_displacement(run: Run, read: Read) -> tuple[np.ndarray, np.ndarray]:
    """Sites along x and displacements along x, averaged over time."""
    late = [time for time in run.times if time >= SETTLED * run.times[-1]]
    found = [read(time).displacement[:, 0] for time in late]
    return read(0.0).reference[:, 0], np.mean(found, axis=0)


def slope(x: np.ndarray, u: np.ndarray, low: float, high: float) -> float:
    """Strain of the stretch from low to high."""
    there = (x >= low) & (x <= high)
    return float(np.polyfit(x[there], u[there], 1)[0])


def temperature(run: Run, atoms: int) -> float:
    """Of the free atoms, from the kinetic energy of their side."""
    late = run.energies.time >= SETTLED * END
    return float(run.energies.md.kinetic[late].mean() / atoms)


def expansion(scheme: SchemeName | Literal["sites"]) -> list[Check]:
    """Strains of atoms and points against lattice dynamics and atoms alone; energy."""
    case = expanding(scheme)
    alone = case | {"only": "md"}
    alone["md"] = case["md"] | {"variables": {"kinetic": 2.0 * TEMPERATURE}}
    runs = run_all([("coupled", case, ()), ("md", alone, ())])
    run, md = runs["coupled"], runs["md"]
    left, right = run.plan.coupled.interfaces[0].planes[0]
    rim, length = RIM * H, case["domain"]["box"][0][1]

    site, u = mean_displacement(run, run.atoms)
    count = int(((site > left) & (site < right)).sum())
    atoms = slope(site, u, left + rim, right - rim)
    atoms /= strain_at(temperature(run, count))
    site, u = mean_displacement(md, md.atoms)
    alone_strain = slope(site, u, rim, length - rim) / strain_at(temperature(md, site.size))

    site, u = mean_displacement(run, run.points)
    cold = strain_at(TEMPERATURE)
    sides = [(rim, left - rim), (right + rim, length - rim)]
    points = np.mean([slope(site, u, *side) for side in sides]) / cold
    near = [(left - H, left), (right, right + H)]
    first = np.mean([slope(site, u, *side) for side in near]) / cold
    total = sum(energies(run))
    return [
        Check("T = 0.05, strain of the atoms / theory", atoms, 0.95, 1.03, DYNAMICS),
        Check("the same, atoms alone", alone_strain, 0.95, 1.03, DYNAMICS),
        Check(
            "atoms, coupled / alone, at equal T", atoms / alone_strain, 0.97, 1.03, "noise 1 % each"
        ),
        Check(
            "strain of the points / theory",
            points,
            0.98,
            1.02 + NODES,
            "nodes' vibrations add up to 7 %",
        ),
        Check(
            "strain of the cells at the planes / that of all points",
            first / points,
            0.95,
            1.08,
            "uniform; noise 3 %; 1.16 without the rods' thermal forces",
        ),
        Check(
            "energy, largest departure",
            abs(total - 1.0).max(),
            high=2e-3 if scheme == "sites" else SCHEMES[scheme].thermal or 2e-3,
            source=SOURCE,
        ),
    ]
