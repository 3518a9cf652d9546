"""Sizes and signs of the numbers in a case."""

from __future__ import annotations

import re
from collections.abc import Iterator

import msgspec

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.form import Case

HUGE = 1e100
"""Larger numbers, and numbers closer to zero than its inverse, are typing errors; their products
overflow."""

MOST_STEPS, MOST_MD_STEPS = 10**9, 10**12
"""Coupling steps and MD steps beyond which a number of the case is a typing error: at a thousand
coupling steps a second such a run would take eleven days, and most are far slower."""

ROUNDING = 1e-9
"""An interval may exceed the end of the run by this fraction: both may be results of a division."""


def check_numbers(case: Case, rules: Rules) -> None:
    """Numbers of sensible size, positive where they must be."""
    for key, value in _numbers(msgspec.to_builtins(case)):
        rules.require(
            value == 0.0 or 1.0 / HUGE <= abs(value) <= HUGE,
            key,
            value,
            f"must be a number between {1 / HUGE:g} and {HUGE:g} in size",
        )
    positive: list[tuple[str, float | None]] = [
        ("grid.cell", case.grid.cell),
        ("time.end", case.time.end),
        ("time.md_timestep", case.time.md_timestep),
        ("output.interval", case.output.interval),
        ("grid.points_per_axis", case.grid.points_per_axis),
        ("continuum.ranks", case.continuum.ranks),
    ]
    if case.time.md_steps != "auto":
        positive.append(("time.md_steps", case.time.md_steps))
    if case.time.step != "auto":
        positive.append(("time.step", case.time.step))
    if case.continuum.threads != "auto":
        positive.append(("continuum.threads", case.continuum.threads))
    if case.output.energy_interval is not None:
        positive.append(("output.energy_interval", case.output.energy_interval))
    if case.checkpoint is not None:
        positive += [
            ("checkpoint.minutes", case.checkpoint.minutes),
            ("checkpoint.steps", case.checkpoint.steps),
            ("checkpoint.keep", case.checkpoint.keep),
        ]
    if case.md is not None:
        positive += [("md.ranks", case.md.ranks), ("md.cutoff", case.md.cutoff)]
    for key, number in positive:
        rules.require(number is None or number > 0, key, number, "must be positive")
    _check_steps(case, rules)
    for key, interval in (
        ("output.interval", case.output.interval),
        ("output.energy_interval", case.output.energy_interval),
    ):
        rules.require(
            interval is None or not 0 < case.time.end * (1.0 + ROUNDING) < interval,
            key,
            interval,
            f"is longer than the run, whose time.end is {case.time.end:g}",
            f"write {case.time.end:g} or less; the state at the end is always written",
        )
    for name in ("outer", "inner", "filter"):
        width = getattr(case.coupling.zones, name)
        key = f"coupling.zones.{name}"
        rules.require(width is None or width > 0, key, width, "must be positive")
    width = case.coupling.zones.incommunicado
    rules.require(
        width is None or width >= 0,
        "coupling.zones.incommunicado",
        width,
        "must not be negative",
    )
    rules.require(
        case.coupling.filter_rate is None or case.coupling.filter_rate >= 0,
        "coupling.filter_rate",
        case.coupling.filter_rate,
        "must not be negative",
    )
    xpic = case.continuum.xpic
    rules.require(xpic.order >= 1, "continuum.xpic.order", xpic.order, "must be at least 1")
    rules.require(
        xpic.every == "auto" or xpic.every >= 0,
        "continuum.xpic.every",
        xpic.every,
        "must not be negative",
    )
    flip = case.continuum.flip
    rules.require(
        0.0 <= flip <= 1.0,
        "continuum.flip",
        flip,
        "must be a fraction between 0 (PIC) and 1 (FLIP)",
    )
    rules.require(
        re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", case.name) is not None,
        "name",
        case.name,
        "must be usable as the name of a folder: only letters A-Z a-z, digits and . _ -",
    )


def _check_steps(case: Case, rules: Rules) -> None:
    """The number of steps, as far as it is known without the material."""
    time, limits = case.time, []
    if time.md_timestep is not None:
        limits.append(("time.md_timestep", time.md_timestep, 1, MOST_MD_STEPS, "MD steps"))
        if time.md_steps != "auto":
            coupling = ("time.md_timestep", time.md_timestep, time.md_steps)
            limits.append((*coupling, MOST_STEPS, "coupling steps"))
    if time.step != "auto":
        limits.append(("time.step", time.step, 1, MOST_STEPS, "steps"))
    for key, dt, factor, most, what in limits:
        if dt > 0 and factor > 0:
            count = time.end / (factor * dt)
            if not rules.require(
                count <= most,
                key,
                dt,
                f"would take {count:.3g} {what} to time.end = {time.end:g}; at most {most:.0e}",
                "make the time step longer, or time.end smaller",
            ):
                break


def _numbers(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    """Yield all floating-point numbers of a case with their keys."""
    if isinstance(value, float):
        yield key, value
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _numbers(item, f"{key}.{name}" if key else name)
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{key}[{index}]")
