"""Growth and arrest of the mode I crack at p = 0.15 (paper figures 14 and 15)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.analysis.crack import CrackGrowth, crack_growth
from gimpmd_deploy.analysis.energy_release import EnergyReleaseRate, energy_release_rate
from gimpmd_deploy.analysis.j_integral import JIntegral, j_integral
from gimpmd_deploy.analysis.resistance import crack_resistance
from gimpmd_deploy.figures.style import COLOURS, INK, SOFT, pyplot, save, unit_label
from gimpmd_deploy.results.run import Run
from tests.paper.jobs import QUARTER, Job
from tests.paper.page import Result, Row, picture

GROWING = "mode1-p015"
HISTORY = [[0, 0], [10, 1], [210, 1], [220, 0]]
"""The paper applies the load from 0 to 210; as its other load, it grows and falls over 10."""
WINDOW = 16.0 / 360.0
"""Width of the window of the rates, over the time of the run."""
QUIET = 0.25
"""Part of the run in which the wave of the load has not reached the crack."""
LIMITS = (-0.4, 0.4)
GRIFFITH = 0.95
"""J scatters by a few percent while it holds its value."""


def _load(value: float) -> dict[str, Any]:
    return {"condition": "traction", "value": [0, value], "history": HISTORY}


FULL = Job(
    GROWING,
    "mode1",
    {
        "time.end": 360,
        "output.interval": 2.56,
        "boundary.top": _load(0.15),
        "boundary.bottom": _load(-0.15),
    },
)
INTEGRATORS = {"USL": "20 % lost", "MUSL": "below 8 %"}
"""Integrators of the paper's coupling at a quarter of the size: a damping one and another one."""


def by_the_paper(integrator: str) -> Job:
    """Return the run at a quarter of the size with the coupling of the paper."""
    changes = {"coupling": {"scheme": "paper"}, "continuum.integrator": integrator.lower()}
    small = FULL.quarter()
    return Job(_name(integrator), small.example, {**small.changes, **changes})


def _name(integrator: str) -> str:
    return f"quarter-paper-{integrator.lower()}"


JOBS = [FULL, *(by_the_paper(integrator) for integrator in INTEGRATORS)]


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Energies, crack tip, both energy release rates and the resistance; figures 14 and 15."""
    run = runs[GROWING]
    end = run.case.time.end
    growth = crack_growth(run, times=[time for time in run.times if time >= QUIET * end])
    resistance = crack_resistance(run)
    rates = energy_release_rate(run, growth, resistance, WINDOW * end)
    found = j_integral(run, times=run.times[::2])
    energies, moved = run.energies, away(growth)
    images = folder / "images"
    figures = [
        (draw_energies(run, images / f"{GROWING}-energies.png"), "Energies (figure 14)."),
        (
            draw_rates(run, growth, rates, found, images / f"{GROWING}-rates.png"),
            "Energy release rate, resistance and length of the crack (figure 15).",
        ),
        (
            picture(run, "sigma_yy", end, folder, LIMITS),
            f"Stress at t = {end:g}.",
        ),
    ]
    rows = [
        Row("14", "total energy less work of the load at the end, over the work",
            "-20 %; without damping below 8 %", f"{_end(run):+.3%}", GROWING),
        Row("14", "largest difference of total energy and work, over the largest work", "-",
            f"{energies.largest_imbalance():.3%}", GROWING),
        *(Row("14", f"the same, scheme of the paper by {integrator}, quarter size", paper,
              f"{_end(runs[_name(integrator)]):+.1%}", _name(integrator))
          for integrator, paper in INTEGRATORS.items()),
        Row("5.1", "tip leaves its place; one atom ahead of it (start of growth)", "225",
            f"{shown_time(moved[0])}; {shown_time(growth.start)}", GROWING),
        Row("5.1", "tip at its farthest place (arrest); back at its first place",
            "334", f"{shown_time(growth.arrest)}; {shown_time(moved[1])}", GROWING),
        *_quarters(runs),
        Row("15", "resistance 2 gamma (LAMMPS)", "-", f"{resistance:.3f}", GROWING),
        Row("15", "J around the MD region when growth starts", "above the resistance",
            _at(found.time, found.J, growth.start), GROWING),
        Row("15", "J around the MD region at arrest", "below the resistance",
            _at(found.time, found.J, growth.arrest), GROWING),
        Row("15", "J around the MD region, mean and scatter while the crack grows", "-",
            _spread(_while_growing(found, growth)), GROWING),
        Row("5.1", f"J is below {GRIFFITH:g} of the resistance from here on", "330",
            shown_time(_falls_below(found, GRIFFITH * resistance)), GROWING),
        Row("15", "largest energy release rate from the energies: less, and with, kinetic energy",
            "above the resistance", f"{_largest(rates.dynamic)}; {_largest(rates.static)}",
            GROWING),
        Row("5.1", "largest advance of the crack", "-",
            f"{growth.length.max() - growth.length[0]:.1f}", GROWING),
        Row("5.1", "largest speed of the tip (c_R = 5.02)", "-",
            _largest(growth.speed(WINDOW * end)), GROWING),
    ]  # fmt: skip
    return Result("Growth and arrest of the mode I crack", TEXT, rows, figures)


def _quarters(runs: Mapping[str, Run]) -> list[Row]:
    """Start and arrest in the runs of a quarter of the size."""
    rows = []
    for integrator in INTEGRATORS:
        growth = crack_growth(runs[_name(integrator)])
        times = [None if time is None else QUARTER * time for time in (growth.start, growth.arrest)]
        ours = ", ".join(shown_time(time) for time in times)
        quantity = (
            f"start and arrest, quarter size, times {QUARTER:g}: scheme of the paper, {integrator}"
        )
        rows.append(Row("5.1", quantity, "225, 334", ours, _name(integrator)))
    return rows


def _end(run: Run) -> float:
    """Total energy less the work of the load, at the end, over the work."""
    return float(-run.energies.imbalance()[-1] / run.energies.external_work[-1])


def shown_time(value: float | None) -> str:
    return "none" if value is None else f"{value:.0f}"


def away(growth: CrackGrowth) -> tuple[float | None, float | None]:
    """First output with the tip away from its first place; first one with it back there."""
    away = np.flatnonzero(growth.length > growth.length[0])
    if not away.size:
        return None, None
    back = growth.time[away[-1] + 1 :]
    return float(growth.time[away[0]]), float(back[0]) if back.size else None


def _falls_below(found: JIntegral, value: float) -> float | None:
    """First output from which on J stays below a value."""
    above = np.flatnonzero(value <= found.J)
    below = found.time[above[-1] + 1 :] if above.size else found.time
    return float(below[0]) if below.size else None


def _spread(values: Any) -> str:
    return f"{np.mean(values):.2f} +- {np.std(values):.2f}"


def _at(time: Any, values: Any, when: float | None) -> str:
    return "none" if when is None else f"{np.interp(when, time, values):.2f}"


def _largest(values: Any) -> str:
    return f"{np.nanmax(values):.2f}" if np.isfinite(values).any() else "none"


def _while_growing(found: JIntegral, growth: CrackGrowth) -> Any:
    if growth.start is None:
        return np.array([np.nan])
    end = found.time[-1] if growth.arrest is None else growth.arrest
    return found.J[(found.time >= growth.start) & (found.time <= end)]


def draw_energies(run: Run, path: Path) -> Path:
    """Work of the load, total energy, potential energy over time, as figure 14."""
    energies, style = run.energies, run.plan.units
    figure, axes = pyplot().subplots(figsize=(6.4, 4.0))
    lines = (
        (energies.external_work, "work of the load", INK, "-", 3.0),
        (energies.energy - energies.energy[0], "total energy", COLOURS[1], "--", 1.6),
        (energies.potential - energies.potential[0], "potential energy", COLOURS[0], "-", 1.6),
    )
    for values, label, colour, dashes, width in lines:
        axes.plot(energies.time, values, dashes, color=colour, lw=width, label=label)
    axes.set_xlabel(f"time ({unit_label(style, 'time')})")
    axes.set_ylabel(f"energy ({unit_label(style, 'energy')})")
    axes.legend()
    return save(figure, path)


def draw_rates(
    run: Run, growth: CrackGrowth, rates: EnergyReleaseRate, found: JIntegral, path: Path
) -> Path:
    """Energy release rates and resistance, and below the length of the crack, as figure 15."""
    style = run.plan.units
    figure, (upper, lower) = pyplot().subplots(
        2, 1, figsize=(6.4, 5.6), sharex=True, height_ratios=[2, 1]
    )
    upper.plot(found.time, found.J, "-", color=COLOURS[0], lw=1.6, label="J around the MD region")
    upper.plot(rates.time, rates.dynamic, "--", color=COLOURS[5], lw=1.6, label="from the energies")
    upper.axhline(rates.resistance, color=INK, lw=1.2, ls=":", label="resistance $2\\gamma$")
    upper.set_ylabel(
        f"energy release rate\n({unit_label(style, 'energy')}/{unit_label(style, 'length')})"
    )
    upper.set_ylim(min(0.0, float(np.nanmin(found.J))), None)
    upper.legend()
    lower.plot(growth.time, growth.length, color=COLOURS[0], lw=1.6)
    lower.set_ylabel(f"length of the\ncrack ({unit_label(style, 'length')})")
    lower.set_xlabel(f"time ({unit_label(style, 'time')})")
    for time, side in ((growth.start, "start"), (growth.arrest, "arrest")):
        if time is not None:
            for axes in (upper, lower):
                axes.axvline(time, color=SOFT, lw=0.8, ls="--")
            lower.text(
                time, 1.02, side, color=SOFT, ha="center", transform=lower.get_xaxis_transform()
            )
    return save(figure, path)


TEXT = """
The balance of the energy holds to a few parts in 100,000: neither the grid nor the planes take
anything from the motion.

The tip moves when J around the MD region has nearly reached the energy of the two surfaces that
the crack makes, as Griffith's criterion asks. J holds this value while the crack grows: it grows
just as fast as the load allows, at a small part of the speed of Rayleigh waves. The rate from the
energies of the whole model agrees, if the change of the kinetic energy is subtracted. If it is
not, as for a body that moves slowly, the rate is far above the resistance: the plates still gain
speed from the load.

The load ends at t = 210. The wave that says so reaches the crack at about 306, the crack stops,
and J falls below the resistance at nearly the time of the paper. Then the faces of the crack meet
again. At 0 K they are clean, so they bond, and the tip goes back to its first place. J keeps the
energy of the surfaces on most of the way back. The tip comes to rest there at nearly the time
that the paper gives for the arrest. The paper does not say how its load begins; ours grows over 10.
The next section shows that this and the scheme of the paper explain when its crack starts.
"""
