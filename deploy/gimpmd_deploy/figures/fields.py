"""Fields of both sides, drawn at chosen times with the same colours.

In three dimensions the figures show a slice through the middle of the body, in the plane of
constant z.
"""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.figures.colours import given_scale, scale_of
from gimpmd_deploy.figures.picture import Look, draw_picture
from gimpmd_deploy.figures.registry import run_figure
from gimpmd_deploy.figures.shown import Shown, show
from gimpmd_deploy.figures.style import save
from gimpmd_deploy.figures.windows import INTERFACE, WINDOWS, Window, inside, windows_of
from gimpmd_deploy.results.fields import describe, field_names
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import InputError, Problem

MANY = 12
"""Largest number of figures over time, unless all are asked for."""

SAMPLES = 3
"""Largest number of outputs from which colour scales are chosen, and what the axes must show."""

STRAY = 0.05
"""Percentage of the particles at each end of an axis that may lie outside the axes."""

Read = Callable[[float], dict[Any, Particles]]
"""Returns the particles of a run at a time."""


@dataclass(frozen=True)
class Choice:
    """What the user chose of a figure.

    Attributes
    ----------
    limits : ends of the colour scale; None: found from the values.
    window : the only part of the body to show; None: the whole body, with windows.
    windows : names of the windows that may be drawn beside the whole body.
    """

    limits: tuple[float, float] | None = None
    window: Window | None = None
    windows: tuple[str, ...] = WINDOWS


@run_figure("fields")
def draw_chosen(run: Run, folder: Path, every: bool) -> list[Path]:
    """Draw the fields that the case chooses, as far as the run has them."""
    has = names_of(run)
    names = [name for name in run.case.output.figures if name in has]
    return draw_fields(run, names, folder, some_times(run, every))


def names_of(run: Run) -> list[str]:
    """Return the names of all fields of a run, of atoms and of material points.

    Raises
    ------
    InputError
        The run wrote no output.
    """
    sides = run.particles(run.times[0]).values()
    return list(dict.fromkeys(name for p in sides for name in field_names(p, run.plan.units)))


def check_names(run: Run, names: Sequence[str]) -> None:
    """Refuse names of fields that the run does not have.

    Raises
    ------
    InputError
        Names the fields that there are.
    """
    has = names_of(run)
    hint = f"it has {', '.join(has)}"
    problems = [
        Problem("--field", name, "the run has no such field", hint)
        for name in names
        if name not in has
    ]
    if problems:
        raise InputError(str(run.folder), problems)


def some_times(run: Run, every: bool) -> list[float]:
    """Times of all outputs, or of at most a dozen of them with the first and the last."""
    return run.times if every else _spread(run.times, MANY)


def draw_fields(
    run: Run, names: Sequence[str], folder: Path, times: Sequence[float], choice: Choice = Choice()
) -> list[Path]:
    """Draw ``NAME_NNNN.png`` for each field and time; for the last output also ``NAME.png``.

    Parameters
    ----------
    names : sequence of str
        Fields that the run has; see `names_of`.
    times : sequence of float
        Outputs of the run; figures of a field have the same colours at all of them.
    """
    read = lru_cache(maxsize=1)(run.particles)
    looks, outputs, drawn = looks_of(run, names, times, choice, read), run.times, []
    zoom = "" if choice.window is None else "_window"
    for time in times:
        for look in looks:
            path = folder / f"{look.name}{zoom}_{outputs.index(time):04d}.png"
            shown = show(run, time, read(time), look.name)
            drawn.append(save(draw_picture(run, shown, look), path))
            if time == outputs[-1]:
                drawn.append(Path(shutil.copyfile(path, folder / f"{look.name}{zoom}.png")))
    return drawn


def looks_of(
    run: Run, names: Sequence[str], times: Sequence[float], choice: Choice, read: Read
) -> list[Look]:
    """Choose the colours of fields, and what the axes show, from a few of the times."""
    samples: dict[str, list[Shown]] = {name: [] for name in names}
    for time in _spread(times, SAMPLES):
        for name in names:
            samples[name].append(show(run, time, read(time), name))
    return [_look(run, name, shown, choice) for name, shown in samples.items()]


def _look(run: Run, name: str, samples: Sequence[Shown], choice: Choice) -> Look:
    kind, body, window = describe(name).kind, run.plan.domain.box[:2], choice.window
    box = window or _around(body, [p for shown in samples for p in shown.sets()])
    if choice.limits is not None:
        scale, close = given_scale(*choice.limits, kind), {}
    else:
        scale = scale_of([v for shown in samples for v in _values(shown, name, box)], kind)
        near: dict[str, list[Floats]] = defaultdict(list)
        for shown in samples if window is None else ():
            for key, place in windows_of(run, shown, name).items():
                near[key] += _values(shown, name, place)
        close = {key: scale_of(v, kind) for key, v in near.items() if key != INTERFACE}
    return Look(name, box, scale, close, choice.windows if window is None else ())


def _values(shown: Shown, name: str, window: Window) -> list[Floats]:
    """Values of a field in a window, on each side that has it."""
    sets = [inside(p, window) for p in shown.sets()]
    return [p.fields[name] for p in sets if p is not None and name in p.fields]


def _around(body: Any, sets: Sequence[Particles]) -> Window:
    """Limits along x and y of the body and of nearly all particles."""
    low, high = np.transpose(body)
    for p in sets:
        ends = np.percentile(p.position[:, :2], [STRAY, 100.0 - STRAY], axis=0)
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    return (x0, x1), (y0, y1)


def _spread(times: Sequence[float], count: int) -> list[float]:
    """At most so many of the times, spread evenly, with the first and the last one."""
    if len(times) <= count:
        return list(times)
    chosen = np.unique(np.linspace(0, len(times) - 1, count).round().astype(int))
    return [times[index] for index in chosen]
