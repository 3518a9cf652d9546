"""Wave packets across the interface: both ways, P and S, straight and oblique, N, levels, ranks."""

from __future__ import annotations

import math
from typing import Any, Literal

from tests.physics.gimp.gates import Check
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import SCHEMES, SOURCE, SchemeName, coupled
from tests.physics.strips import H, Wave, crossing, ground, plain, two_ranks

Way = Literal["into", "out"]

STEPS = {"md_steps": 16, "md_timestep": 0.005}
"""The coupling step is 0.08, as in the study; N is no limit of accuracy."""

WAYS: tuple[Way, ...] = ("into", "out")
ALONE = ("--only", "continuum")


def strip(scheme: SchemeName, wave: Wave, way: Way, **steps: Any) -> dict[str, Any]:
    return coupled(plain(ground(**(STEPS | steps)).strip(wave, way)), scheme)


def grid(wave: Wave, **steps: Any) -> dict[str, Any]:
    """The same strip for the continuum alone; it is the same in every scheme."""
    return plain(ground(**(STEPS | steps)).strip(wave, "into"))


def judged(
    scheme: SchemeName,
    wave: Wave,
    way: Way,
    shares: tuple[float, float],
    of_grid: tuple[float, float],
) -> list[Check]:
    """What is required of R and T of one wave; a wave without a bound gives no check."""
    bounds, label = SCHEMES[scheme], f"{wave.label} {way}"
    (R, T), (R_grid, T_grid) = shares, of_grid
    checks = []
    if wave.wavelength >= bounds.reflected_from:
        checks.append(
            Check(
                f"{label}, R less the grid's", R - R_grid, high=bounds.reflected_more, source=SOURCE
            )
        )
    if wave.wavelength >= bounds.transmitted_from:
        off = bounds.transmitted_off
        checks.append(Check(f"{label}, T", T, 1.0 - off, 1.0 + off, SOURCE))
    if bounds.transmitted_less is not None:
        less = -bounds.transmitted_less
        checks.append(Check(f"{label}, T less the grid's", T - T_grid, low=less, source=SOURCE))
    if (wave.wavelength, wave.polarization, way) == (8.0, "P", "out"):
        checks.append(Check(f"{label}, T", T, low=bounds.out_at_8, source=SOURCE))
    return checks


def crossings(scheme: SchemeName, waves: list[Wave]) -> list[Check]:
    """All waves, both ways, beside the grid alone."""
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = []
    for wave in waves:
        cases += [((wave, way), strip(scheme, wave, way), ()) for way in WAYS]
        cases.append(((wave, "grid"), grid(wave), ALONE))
    shares = {key: crossing(run) for key, run in run_all(cases).items()}
    return [
        check
        for wave in waves
        for way in WAYS
        for check in judged(scheme, wave, way, shares[wave, way], shares[wave, "grid"])
    ]


def short_packets(scheme: SchemeName) -> list[Check]:
    return crossings(scheme, [Wave(12.0, "P")])


def long_packets(scheme: SchemeName) -> list[Check]:
    return crossings(
        scheme, [Wave(length, kind) for length in (40.0, 20.0, 12.0, 8.0) for kind in ("P", "S")]
    )


def oblique(scheme: SchemeName) -> list[Check]:
    """A P and an S wave of 12 cells at 30 degrees."""
    return crossings(scheme, [ground().oblique(12.0, kind, 30.0) for kind in ("P", "S")])


def temporal_factor(scheme: SchemeName) -> list[Check]:
    """A P wave of 12 cells out of the atoms at N = 1, 10 and 40."""
    wave = Wave(12.0, "P")
    steps = {1: 0.005, 10: 0.005, 40: 0.002}
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = [
        (n, strip(scheme, wave, "out", md_steps=n, md_timestep=dt), ()) for n, dt in steps.items()
    ]
    cases.append(("grid", grid(wave), ALONE))
    shares = {key: crossing(run) for key, run in run_all(cases).items()}
    checks = []
    for n in steps:
        checks += [
            Check(f"N = {n}: {c.what}", c.measured, c.low, c.high, c.source)
            for c in judged(scheme, wave, "out", shares[n], shares["grid"])
        ]
    T, off = [shares[n][1] for n in steps], SCHEMES[scheme].transmitted_off
    checks.append(
        Check(
            "12 h, T at N = 1, 10, 40: spread",
            max(T) - min(T),
            high=off,
            source="N is no limit: as off as T may be",
        )
    )
    return checks


def ranks(scheme: SchemeName) -> list[Check]:
    """The same wave with one MPI rank of atoms and with two."""
    one = strip(scheme, Wave(8.0, "S"), "out")
    two = two_ranks(strip(scheme, Wave(8.0, "S"), "out"))
    runs = run_all([(1, one, ()), (2, two, ())])
    (R1, T1), (R2, T2) = (crossing(runs[n]) for n in (1, 2))
    difference = max(abs(R1 - R2), abs(T1 - T2))
    return [Check("8 h S out, 1 rank against 2", difference, high=1e-7, source="round-off")]


def levels(scheme: SchemeName) -> list[Check]:
    """A coarser level beyond the interface: a P wave of 24 cells crosses both.

    The level's rim lies 16 cells before the interface; the wave has 12 coarse cells there. The
    same levels without atoms say what the grid does to the wave by itself.
    """
    wave = Wave(24.0, "P")
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = []
    for way in WAYS:
        case = nested(strip(scheme, wave, way))
        cases.append((way, case, ()))
    cases.append(("grid", nested(grid(wave)), ALONE))
    shares = {key: crossing(run) for key, run in run_all(cases).items()}
    return [
        Check(f"levels: {c.what}", c.measured, c.low, c.high, c.source)
        for way in WAYS
        for c in judged(scheme, wave, way, shares[way], shares["grid"])
    ]


def nested(case: dict[str, Any]) -> dict[str, Any]:
    """A strip, four cells wide, whose cells are twice as large far from the atoms."""
    (start, end), (low, _) = case["domain"]["box"]
    interface = case["md"]["region"][0][0]
    before, behind = (
        2 * math.ceil(side / (2 * H) - 1e-9) for side in (interface - start, end - interface)
    )
    start, end = interface - before * H, interface + behind * H
    rim = [low, low + 4 * H]
    case["domain"]["box"] = [[start, end], rim]
    case["md"]["region"] = [[interface, end], rim]
    case["grid"]["cell"] = 2 * H
    case["grid"]["levels"] = [{"boxes": [[[interface - 16 * H, end], rim]]}]
    return case
