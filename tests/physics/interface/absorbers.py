"""The absorber in whole coupled strips: what it leaves, what it takes, and what it keeps warm.

The study behind docs/theory.md gives what a packet loses and how much of a short wave comes back
at a rate of 2, with the least-squares fit in the place of three corrections.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_md.coupling.absorber import CORRECTIONS
from gimpmd_schemas.case.derive.choices import ABSORBER_CELLS
from gimpmd_schemas.case.initial_state import packet_strain
from tests.physics.gimp.gates import Check
from tests.physics.interface.noise import warm_case
from tests.physics.interface.packets import Way, strip
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import SchemeName
from tests.physics.strips import A, H, Run, Wave, crossing

RATE = 2.0
STUDY = "study"
T_LESS = {8.0: 0.002, 12.0: 0.0007}
"""By how much T of packets of so many cells falls, in the study."""
R_LEFT = {2.0: 0.14, 1.5: 0.09}
"""R of packets of so many cells, in the study."""


def absorbing(case: dict[str, Any], **settings: float) -> dict[str, Any]:
    """The case with an absorber."""
    case["coupling"]["absorber"] = {"rate": RATE, **settings}
    return case


def resolved_packets(scheme: SchemeName) -> list[Check]:
    """P packets that the grid carries lose what the formula says, about what the study has."""
    waves: list[tuple[float, Way]] = [(8.0, "into"), (8.0, "out"), (12.0, "out")]
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = []
    for wave in waves:
        length, way = wave
        cases.append(((wave, "with"), absorbing(strip(scheme, Wave(length), way)), ()))
        cases.append(((wave, "without"), strip(scheme, Wave(length), way), ()))
    runs, checks = run_all(cases), []
    for wave in waves:
        length, way = wave
        run, label, less = runs[wave, "with"], f"{length:g} h {way}", T_LESS[length]
        (R, T), (R0, T0) = crossing(run), crossing(runs[wave, "without"])
        taken = run.energies.dissipated[-1] / run.energies.energy[0]
        checks += [
            # the study's fit leaves 0.55 of what three corrections do of 8 cells
            Check(f"{label}, T falls by", T0 - T, high=2.0 * less, source=f"2 x {STUDY}"),
            Check(f"{label}, R changes by", abs(R - R0), high=less, source="T's, " + STUDY),
            # to first order in g dt, at the speed of long waves, without what comes back
            Check(
                f"{label}, taken over theory", taken / taken_in_theory(run), 0.85, 1.15, "formula"
            ),
        ]
    return checks


def taken_in_theory(run: Run) -> float:
    """Share of a P packet's energy that the absorber takes while it passes, by the formula.

    A wave exp(i k x) of velocity one carries ``density c`` across a unit of width and loses
    ``g m v* R D R v`` in the band, whose columns of atoms lie a / 2 apart along a close-packed row.
    The packet's Fourier components share its energy as their velocities squared.
    """
    plane, packet = run.plan.coupled.interfaces[0].planes[0][0], run.plan.initial.packets[0]
    width = ABSORBER_CELLS * H
    depth = np.arange(0.25 * A, width, 0.5 * A)
    nodes = run.plan.domain.box[0][0] + H * np.arange(run.plan.background_grid().cells[0] + 1)
    S = np.clip(1.0 - np.abs(plane + depth[:, None] - nodes) / H, 0.0, None)
    S = S[:, S.sum(axis=0) > 0.0]
    once = np.eye(len(depth)) - S @ (S.T / S.sum(axis=0)[:, None])
    R = np.linalg.matrix_power(once, CORRECTIONS)
    D = np.clip(1.5 * (1.0 - depth / width), 0.0, 1.0)

    half = 6.0 * packet.cycles * packet.wavelength
    x, dx = np.linspace(-half, half, 4096, endpoint=False, retstep=True)
    density = np.abs(np.fft.rfft(packet_strain(packet, x + packet.center)[1])) ** 2
    k = 2.0 * np.pi * np.fft.rfftfreq(x.size, dx)
    seen = density > 1e-6 * density.max()
    waves = np.exp(1j * k[seen] * depth[:, None])
    loss = (D[:, None] * np.abs(R @ waves) ** 2).sum(axis=0)
    mean = float((density[seen] * loss).sum() / density[seen].sum())
    return RATE * 0.5 * A * mean / run.plan.wave_speed("P")


def short_waves(scheme: SchemeName) -> list[Check]:
    """P packets that find no grid mode, out of the atoms, and the ledger of what they lose."""
    sizes = {(2.0, 16): "", (1.5, 16): "", (2.0, 1): ", N = 1"}
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = []
    for length, n in sizes:
        cases.append(
            ((length, n, "with"), absorbing(strip(scheme, Wave(length), "out", md_steps=n)), ())
        )
        cases.append(((length, n, "without"), strip(scheme, Wave(length), "out", md_steps=n), ()))
    runs, checks = run_all(cases), []
    for (length, n), note in sizes.items():
        run, bare = runs[length, n, "with"], runs[length, n, "without"]
        label = f"{length:g} h{note}"
        checks += [
            Check(f"{label}, R without it", crossing(bare)[0], low=0.9, source="it is needed"),
            # the study's packets and node lines are its own
            Check(f"{label}, R", crossing(run)[0], high=1.1 * R_LEFT[length], source=STUDY),
            Check(
                f"{label}, energy + dissipated, departure over that without",
                run.energies.largest_imbalance() / bare.energies.largest_imbalance(),
                high=1.0,
                source="the scheme's own",
            ),
        ]
        if n == 1:
            checks.append(
                Check(
                    f"{label}, the same, departure",
                    run.energies.largest_imbalance(),
                    high=5e-4,
                    source="N = 1",
                )
            )
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
        # every push, so the sum walks within the scheme's own 1 %
        Check(
            "energy + dissipated, departure",
            kept.energies.largest_imbalance(),
            high=0.01,
            source="acceptance",
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


def temperatures(run: Run) -> np.ndarray:
    """Kinetic temperature of the free atoms, of mass one, at every step."""
    md = run.energies.md
    found: np.ndarray = md.kinetic / md.mass[0]
    return found
