"""A short strip with two interfaces that nothing leaves: broadband waves, heat, held strain."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from gimpmd_md.coupling.projection import ITERATIONS, step_sizes
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.interpolation import stencil
from tests.physics.gimp.gates import Check
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import COMPARED, SCHEMES, SOURCE, SchemeName, coupled
from tests.physics.strips import H, Run, broadband_case, energies, strain_error, two_ranks

SIDE, MIDDLE = 8, 14
"""Cells of each continuum and of the atoms between."""


def fifths(time: np.ndarray, values: np.ndarray) -> float:
    """Mean over the last fifth of the time less the mean over the second."""
    end = time[-1]
    second = (time >= 0.2 * end) & (time < 0.4 * end)
    return float(values[time >= 0.8 * end].mean() - values[second].mean())


Energies = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Time, and energy of the continuum and of the atoms over all of the start."""


def energies_of(*runs: Run) -> Energies:
    """Energies of runs together."""
    sides = np.sum(
        [
            [getattr(run.energies.sides[role], kind) for role in ("continuum", "md")]
            for run in runs
            for kind in ("kinetic", "potential")
        ],
        axis=0,
    )
    continuum, md = sides / sides[:, 0].sum()
    return runs[0].energies.time, continuum, md


def broadband(scheme: SchemeName, cases: dict[Any, dict[str, Any]]) -> dict[Any, Energies]:
    """Energies of cases full of waves.

    In the velocity scheme bonds across the plane count by half, and atoms beside it have potential
    energies of first order in their displacements: up to a fifth of what these waves have. They
    cancel with those of the opposite waves, which run as well.
    """
    signs = (1.0, -1.0) if scheme == "velocity" else (1.0,)
    runs = run_all(
        ((key, sign), with_sign(coupled(case, scheme), sign), ())
        for key, case in cases.items()
        for sign in signs
    )
    return {key: energies_of(*(runs[key, sign] for sign in signs)) for key in cases}


def with_sign(case: dict[str, Any], sign: float) -> dict[str, Any]:
    packets = [one | {"strain": sign * one["strain"]} for one in case["initial"]["packets"]]
    return case | {"initial": case["initial"] | {"packets": packets}}


def broadband_checks(scheme: SchemeName, steps: dict[int, tuple[float, float]]) -> list[Check]:
    """Energy over time at some N, each with its MD time step and end."""
    found = broadband(
        scheme,
        {n: broadband_case(end, md_steps=n, md_timestep=dt) for n, (dt, end) in steps.items()},
    )
    checks = []
    for n, sides in found.items():
        label = f"T = 0, N = {n}"
        high, trend = SCHEMES[scheme].broadband, SCHEMES[scheme].trend
        if scheme == "force" and n == 1:
            high, trend = 1e-4, 1e-4
        checks += energy_checks(label, sides, high, trend)
        if n == 10:
            checks += shares(label, sides)
    return checks


def energy_checks(label: str, sides: Energies, high: float, trend: float | None) -> list[Check]:
    """The total energy of a run full of waves: its largest value, and where it goes."""
    time, continuum, md = sides
    total = continuum + md
    label, change = f"{label}, t = {time[-1]:.0f}", fifths(time, total)
    most = Check(f"{label}, largest E/E0 - 1", total.max() - 1.0, high=high, source=SOURCE)
    if trend is None:
        return [most, Check(f"{label}, trend of E/E0", change, high=0.0, source="no growth")]
    return [most, Check(f"{label}, trend of E/E0", change, -trend, trend, SOURCE)]


def shares(label: str, sides: Energies) -> list[Check]:
    """Energy of each side over the total of the start: there, and before four later times.

    Means over a twentieth of the run, since what belongs to which side swings.
    """
    time, continuum, md = sides
    end, checks = time[-1], []
    for t in np.linspace(0.0, end, 5):
        late = (time >= t - 0.05 * end) & (time <= t * (1.0 + 1e-9))
        means = continuum[late].mean(), md[late].mean()
        span = f"t = {time[late][0]:.0f} .. {t:.0f}"
        what = f"{label}, {span}, E/E0: continuum {means[0]:.3f}, atoms {means[1]:.3f}"
        checks.append(Check(what, sum(means), source=COMPARED))
    return checks


def short_broadband(scheme: SchemeName) -> list[Check]:
    return broadband_checks(scheme, {16: (0.005, 120.0)})


def long_broadband(scheme: SchemeName) -> list[Check]:
    return broadband_checks(scheme, {1: (0.005, 500.0), 10: (0.005, 500.0), 40: (0.002, 500.0)})


def warm_case(scheme: SchemeName, temperature: float, end: float) -> dict[str, Any]:
    """Atoms that start on their sites at twice the temperature: half of it stays kinetic."""
    case = coupled(broadband_case(end, md_steps=16, md_timestep=0.005), scheme)
    case["initial"]["packets"] = []
    case["md"]["after"] = WARM
    case["md"]["variables"] = {"kinetic": 2.0 * temperature}
    case["output"]["interval"] = 4.0
    return case


WARM = "warm.in"


def thermal(scheme: SchemeName, temperature: float, end: float) -> list[Check]:
    """Total energy, its share in the continuum, and the strain near the planes."""
    return thermal_checks(
        scheme, temperature, run_all([(0, warm_case(scheme, temperature, end), ())])[0]
    )


def thermal_checks(scheme: SchemeName, temperature: float, run: Run) -> list[Check]:
    bounds, label = SCHEMES[scheme], f"T = {temperature:g}, t = {run.energies.time[-1]:.0f}"
    continuum, md = energies(run)
    time, total = run.energies.time, continuum + md
    checks = []
    if bounds.thermal is not None:
        most = bounds.thermal
        checks += [
            Check(
                f"{label}, energy, largest departure",
                abs(total - 1.0).max(),
                high=most,
                source=SOURCE,
            ),
            Check(f"{label}, energy, trend", fifths(time, total), -most / 2, most / 2, SOURCE),
        ]
    else:
        checks.append(
            Check(f"{label}, largest E/E0 - 1", total.max() - 1.0, high=0.02, source=SOURCE)
        )
        checks.append(
            Check(
                f"{label}, missing but for what the interface took",
                abs(run.energies.remaining_imbalance()),
                high=0.1,
                source="trapezoid over windows: (w dt)^2 / 12, mean w 14",
            )
        )
    checks += shares(f"T = {temperature:g}", energies_of(run))
    share = continuum[time > 0.5 * time[-1]].mean()
    # degrees of freedom: two per node against two per atom; the filter leaves less
    checks.append(
        Check(f"{label}, continuum's share of the energy", share, 0.0, 0.12, "equipartition")
    )
    times, near = strains(run)
    checks.append(
        Check(
            f"{label}, drift of the strain near the planes",
            fifths(times, near),
            -bounds.drift,
            bounds.drift,
            SOURCE,
        )
    )
    if bounds.off_total is not None:
        off = near - total_strains(run)
        checks += [
            Check(
                f"{label}, inner strain less that of displacements",
                abs(off).max(),
                high=bounds.off_total,
                source=SOURCE,
            ),
            Check(
                f"{label}, the same, change between fifths",
                fifths(times, off),
                -bounds.off_total / 2,
                bounds.off_total / 2,
                source="no growth",
            ),
        ]
    return checks


def strains(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Mean axial strain of the points near the planes over time.

    Near are the inner points of the velocity scheme; of the force scheme those within two cells.
    """
    with h5py.File(run.folder / "fields" / "points.vtkhdf") as file:
        root = file["VTKHDF"]
        time, data = root["Steps/Values"][:], root["PointData"]
        count = int(root["NumberOfPoints"][0])
        near = data["zone"][:count] == 1
        if not near.any():
            x = data["reference"][:count, 0]
            away = np.abs(x - x.mean())
            near = away < away.min() + 2.0 * H
        strain = data["strain"][:, 0].reshape(time.size, count)
    return time, strain[:, near].mean(axis=1)


def total_strains(run: Run) -> np.ndarray:
    """The same of inner points by the atoms' total displacements, over time.

    The consistent projection at rest, written with the full matrix of weights. Inner points are
    written before they take the last window: positions are taken back by it, with the velocities.
    """
    plan, density = run.plan, run.plan.continuum.material.density
    with h5py.File(run.folder / "fields" / "points.vtkhdf") as file:
        root = file["VTKHDF"]
        count = int(root["NumberOfPoints"][0])
        inner = root["PointData/zone"][:count] == 1
        points = root["PointData/reference"][:count, :2][inner]
    frames = [run.atoms(time) for time in run.times]
    S, _ = weights(plan, frames[0].reference, 0.5 / np.sqrt(density))
    _, gradient = weights(plan, points, 0.5 * H / plan.continuum.points_per_axis)
    inverse = np.divide(1.0, S.sum(axis=0), out=np.zeros(S.shape[1]), where=S.any(axis=0))
    found = []
    for atoms in frames:
        u, v = atoms.displacement[:, 0], atoms.velocity[:, 0]
        rest, nodal = u - plan.step * v, np.zeros(S.shape[1])
        for step in (1.0, *step_sizes(ITERATIONS)):
            nodal += step * inverse * (S.T @ (rest - S @ nodal))
        found.append((gradient @ nodal).mean())
    return np.array(found)


def weights(plan: Plan, x: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights of particles on all nodes, and their slopes along x, both ``(n, nodes)``."""
    grid = plan.background_grid()
    S = np.zeros((2, len(x), *grid.cells))
    for k, place in enumerate((x - grid.origin) / grid.cell):
        (i, *along), (j, *across) = (stencil(c, half / grid.cell) for c in place)
        rows, columns = (np.arange(n, n + 3) % m for n, m in zip((i, j), grid.cells, strict=True))
        for which, factors in enumerate((along[:3], np.divide(along[3:], grid.cell))):
            np.add.at(S[which, k], np.ix_(rows, columns), np.outer(factors, across[:3]))
    return S[0].reshape(len(x), -1), S[1].reshape(len(x), -1)


UNIAXIAL = [[2e-3, 0.0], [0.0, 0.0]]
SHEAR = [[0.0, 0.0], [2e-3, 0.0]]


def held_case(
    scheme: SchemeName, gradient: list[list[float]], end: float, md_steps: int = 16
) -> dict[str, Any]:
    """A uniform strain between held ends."""
    case = coupled(broadband_case(end, md_steps=md_steps, md_timestep=0.005), scheme)
    case["initial"]["packets"] = []
    case["initial"]["stretch"] = {"gradient": gradient}
    return case


def held_checks(scheme: SchemeName, label: str, run: Run) -> list[Check]:
    bounds, total = SCHEMES[scheme], sum(energies(run))
    return [
        Check(f"{label}, strain error", strain_error(run), high=bounds.held_strain, source=SOURCE),
        Check(f"{label}, energy", abs(total - 1.0).max(), high=bounds.held_energy, source=SOURCE),
    ]


def held(scheme: SchemeName) -> list[Check]:
    """A uniform strain of 2e-3 between held ends, uniaxial and in shear, for t = 240."""
    kinds = {"uniaxial": UNIAXIAL, "shear": SHEAR}
    runs = run_all((name, held_case(scheme, G, 240.0), ()) for name, G in kinds.items())
    return [check for name, run in runs.items() for check in held_checks(scheme, name, run)]


def nested(case: dict[str, Any]) -> dict[str, Any]:
    """The strip with twice as large cells beyond its ends, where they may begin soonest."""
    (start, end), (low, _) = case["domain"]["box"]
    rim = [low, low + 4 * H]
    case["domain"]["box"] = [[start - 8 * H, end + 8 * H], rim]
    case["md"]["region"][1] = rim
    case["grid"] |= {"cell": 2 * H, "levels": [{"boxes": [[[start, end], rim]]}]}
    return case


LAYOUTS = {"levels": nested, "two ranks": two_ranks}

AS_COUPLED: dict[SchemeName, dict[str, Any]] = {
    "velocity": {"configuration": "reference"},
    "force": {"configuration": "reference", "dispersion": "corrected"},
}
"""How the grid of a coupled run is integrated."""


def held_layouts(scheme: SchemeName) -> list[Check]:
    """The uniaxial strain, shorter, on levels and on two ranks of atoms.

    Forces of fine and of coarse points act on a level's rim at different times. It ripples by a
    share of the strain that falls with the step squared, in the grid alone too, and the energy
    by as much.
    """
    usual = nested(held_case(scheme, UNIAXIAL, 60.0))
    grid = usual | {"only": "continuum", "continuum": usual["continuum"] | AS_COUPLED[scheme]}
    cases = {
        "two ranks": two_ranks(held_case(scheme, UNIAXIAL, 60.0)),
        "levels, N = 1": nested(held_case(scheme, UNIAXIAL, 60.0, md_steps=1)),
        "levels, N = 16": usual,
        "grid": grid,
    }
    runs = run_all((name, case, ()) for name, case in cases.items())
    energy = abs(sum(energies(runs["levels, N = 16"])) - 1.0).max()
    return [
        *(check for name in list(cases)[:2] for check in held_checks(scheme, name, runs[name])),
        Check(
            "levels, N = 16, strain error",
            strain_error(runs["levels, N = 16"]),
            high=1.25 * strain_error(runs["grid"]),
            source="1.25 x the grid alone",
        ),
        Check("levels, N = 16, energy", energy, source=COMPARED),
    ]


def broadband_layouts(scheme: SchemeName) -> list[Check]:
    """Broadband waves, shorter, on levels and on two ranks of atoms."""
    bounds = SCHEMES[scheme]
    found = broadband(
        scheme,
        {
            name: lay(broadband_case(120.0, md_steps=10, md_timestep=0.005))
            for name, lay in LAYOUTS.items()
        },
    )
    return [
        check
        for name, sides in found.items()
        for check in energy_checks(name, sides, bounds.broadband, bounds.trend)
    ]
