"""The absorber in whole coupled strips: what it leaves, what it takes, and what it keeps warm.

``python -m tests.physics.interface.absorbers [force | sites]`` prints the table of
docs/verification.md.
"""

from __future__ import annotations

import argparse
import math
from typing import Any, Literal

import numpy as np

from gimpmd_deploy.verify.strips import Ground
from gimpmd_schemas.case.derive.material import wave_speed
from tests.physics.gimp.gates import Check
from tests.physics.interface.noise import warm_case
from tests.physics.interface.packets import STEPS
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import SchemeName, coupled
from tests.physics.strips import Run, Wave, crossing, ground, plain

AtPlanes = Literal["force", "sites"]

DEEPER = 8.0
"""Cells by which packets start farther inside, so that none of them starts in the band."""

SHORT = (0.867, 2.0, 3.0, 3.5, 4.0)
"""Wavelengths in cells that are to be taken; the first is six layers of atoms."""

MOST_BACK: dict[AtPlanes, tuple[float, str]] = {
    "sites": (0.05, "requirement"),
    "force": (0.15, "measured: this scheme misses the requirement of .05"),
}
"""Share of the energy of short waves that may come back, and why."""


def leaving(
    scheme: AtPlanes, wave: Wave, absorber: dict[str, Any] | None, base: Ground | None = None
) -> dict[str, Any]:
    """A packet that leaves the atoms, of Lennard-Jones or those of a base, and the absorber."""
    base = base or ground(**STEPS, coupling={"scheme": scheme})
    case = plain(base.strip(wave, "out"))
    if scheme == "force":
        case = coupled(case, scheme)
    case["coupling"]["absorber"] = absorber
    for box in (case["domain"]["box"], case["md"]["region"]):
        box[0][1] += DEEPER * base.cell
    case["initial"]["packets"][0]["center"] += DEEPER * base.cell
    step = case["time"]["md_timestep"] * case["time"]["md_steps"]
    speed = wave_speed(base.case, wave.polarization) * math.cos(math.radians(wave.degrees))
    end = case["time"]["end"] + DEEPER * base.cell / speed
    case["time"]["end"] = case["output"]["interval"] = step * math.ceil(end / step)
    return case


def short_waves(scheme: AtPlanes) -> list[Check]:
    """Little of the energy comes back, and the sum with what was taken stays."""
    most, source = MOST_BACK[scheme]
    waves = [Wave(length, kind) for length in SHORT for kind in ("P", "S")]
    runs, checks = run_all((wave, leaving(scheme, wave, {}), ()) for wave in waves), []
    for wave, run in runs.items():
        checks += [
            Check(f"{wave.label}, R", crossing(run)[0], high=most, source=source),
            Check(
                f"{wave.label}, energy + dissipated, departure",
                run.energies.largest_imbalance(),
                high=0.015,
                source="of Verlet with 16 steps, as without absorber",
            ),
        ]
    return checks


def resolved_waves(scheme: AtPlanes) -> list[Check]:
    """Waves that the grid carries cross as without absorber."""
    waves = [Wave(8.0, "P"), Wave(8.0, "S"), Wave(12.0, "P")]
    settings: dict[str, dict[str, Any] | None] = {"with": {}, "without": None}
    runs, checks = (
        run_all(
            ((wave, name), leaving(scheme, wave, absorber), ())
            for wave in waves
            for name, absorber in settings.items()
        ),
        [],
    )
    for wave in waves:
        (R, T), (R0, T0) = (crossing(runs[wave, name]) for name in settings)
        less = 0.006 if wave.wavelength == 8.0 else 0.001
        checks += [
            Check(f"{wave.label}, T falls by", T0 - T, high=less, source="study: .003 to .005"),
            Check(f"{wave.label}, R changes by", abs(R - R0), high=0.001, source="study"),
        ]
    return checks


def heat(scheme: SchemeName) -> list[Check]:
    """Atoms that start at T = 0.05: with the random force they keep it, without it they lose it."""
    T, end, start = 0.05, 240.0, 40.0
    runs = run_all(
        [
            ("kept", absorbing(warm_case(scheme, T, end), temperature=T), ()),
            ("drained", absorbing(warm_case(scheme, T, 60.0)), ()),
        ]
    )
    kept, atoms = runs["kept"], runs["kept"].energies.md.mass[0]  # of mass one
    found = temperatures(kept)[kept.energies.time > start]
    # canonical: var T = T^2 / atoms in the plane, half of that at constant energy; correlation
    # time 1.4 as measured, so 70 independent samples
    mean = (2.0 * 1.4 / (end - start) / atoms) ** 0.5
    return [
        Check("T over that of the bath", found.mean() / T, 1 - 5 * mean, 1 + 5 * mean, "5 sigma"),
        Check("std T over T / sqrt(atoms)", found.std() / T * atoms**0.5, 0.8, 1.2, "canonical"),
        # pushes are booked truly; what steps conserve, those of Verlet too, is off by some share of
        # every push, so the sum walks: .01 to .06 of n k T in the study, and less with smaller N
        Check(
            "energy + dissipated, departure",
            kept.energies.largest_imbalance(),
            high=0.06,
            source="study, three seeds",
        ),
        Check(
            "without a temperature, T at t = 60 over the start",
            temperatures(runs["drained"])[-1] / T,
            high=0.1,
            source="it drains",
        ),
        Check(
            "the same, energy + dissipated, departure",
            runs["drained"].energies.largest_imbalance(),
            high=0.002,
            source="as without absorber",
        ),
    ]


def absorbing(case: dict[str, Any], **settings: float) -> dict[str, Any]:
    """The case with an absorber."""
    case["coupling"]["absorber"] = settings
    return case


def temperatures(run: Run) -> np.ndarray:
    """Kinetic temperature of the free atoms, of mass one, at every step."""
    md = run.energies.md
    found: np.ndarray = md.kinetic / md.mass[0]
    return found


def main() -> None:
    """Print R and T of packets that leave the atoms, without absorber and with it."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.absorbers")
    parser.add_argument("scheme", choices=("force", "sites"), nargs="?", default="sites")
    scheme = parser.parse_args().scheme
    print("| wave | without: R, T | with: R, T | taken | energy balance |\n|---|---|---|---|---|")
    for kind in ("P", "S"):
        for length in (*SHORT, 5.0, 6.0, 8.0, 12.0):
            wave = Wave(length, kind)
            runs = run_all(
                (name, leaving(scheme, wave, absorber), ())
                for name, absorber in (("without", None), ("with", {}))
            )
            (R0, T0), (R, T) = crossing(runs["without"]), crossing(runs["with"])
            energies = runs["with"].energies
            taken, off = energies.dissipated[-1] / energies.energy[0], energies.largest_imbalance()
            shares = f"{R0:.4f}, {T0:.4f} | {R:.4f}, {T:.4f} | {taken:.4f}"
            print(f"| {wave.label} | {shares} | {off:.1e} |", flush=True)


if __name__ == "__main__":
    main()
