"""Options of the commands that draw fields: colours, part of the body, and times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from gimpmd_schemas.errors import InputError, Problem

if TYPE_CHECKING:  # figures load matplotlib and numba, which most commands do not need
    from gimpmd_deploy.figures.fields import Choice
    from gimpmd_deploy.results.run import Run

FieldLimits = Annotated[
    tuple[float, float] | None,
    typer.Option("--limits", metavar="LOW HIGH", help="Ends of the colour scale of one field."),
]
FieldWindow = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--window", metavar="XLO XHI YLO YHI", help="Show this part of the body only."),
]


def choice_of(
    limits: tuple[float, float] | None,
    window: tuple[float, float, float, float] | None,
    names: Sequence[str],
) -> Choice:
    """Return the user's choices of figures of these fields.

    Raises
    ------
    InputError
        Limits or a window without extent, or limits for several fields.
    """
    from gimpmd_deploy.figures.fields import Choice

    problems = []
    if limits is not None and not limits[0] < limits[1]:
        hint = "give the lower one first: --limits -0.3 0.3"
        problems.append(Problem("--limits", limits, "are not in order", hint))
    if limits is not None and len(names) > 1:
        message, hint = "belong to one field", f"choose one of {', '.join(names)} with --field"
        problems.append(Problem("--limits", limits, message, hint))
    if window is not None and not (window[0] < window[1] and window[2] < window[3]):
        hint = "give the lower end of each axis first: --window 0 100 20 80"
        problems.append(Problem("--window", window, "has no area", hint))
    if problems:
        raise InputError("command line", problems)
    return Choice(limits, None if window is None else (window[:2], window[2:]))


def times_near(run: Run, wanted: Sequence[float]) -> list[float]:
    """Return the outputs of a run at these times, without repetition.

    Raises
    ------
    InputError
        There is no output within half a coupling step of one of them.
    """
    from gimpmd_deploy.results.run import find_time

    found = [find_time(run.times, time, 0.5 * run.plan.step) for time in wanted]
    if None in found:
        missing = wanted[found.index(None)]
        hint = "the run wrote output at t = " + ", ".join(f"{t:.6g}" for t in run.times)
        problem = Problem("--time", missing, "the run wrote no output at this time", hint)
        raise InputError(str(run.folder), [problem])
    return [run.times[index] for index in sorted({i for i in found if i is not None})]
