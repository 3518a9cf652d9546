"""Progress of a run: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from gimpmd_deploy.wording import clock, quantity
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.events import (
    Event,
    Found,
    Lost,
    Registered,
    ServiceFailed,
    Waiting,
)
from gimpmd_schemas.wire.events import Progress as Reached

QUIET = 10.0
"""Seconds between two plain lines."""

REFRESH = 0.2
"""Seconds between two refreshes of the bar."""


@dataclass(frozen=True)
class Pace:
    """Work in one coupling step, so that speeds are given in the units of each community.

    Attributes
    ----------
    md_steps : MD steps; 0 in a run of the continuum only.
    atoms : number of atoms; 0 if it is not known.
    time_unit : name of the unit of time.
    """

    md_steps: int
    atoms: int
    time_unit: str

    @classmethod
    def of(cls, plan: Plan, atoms: int) -> Pace:
        """Pace of a plan."""
        return cls(plan.md.steps if plan.md else 0, atoms, UNITS[plan.units].time)

    def speed(self, steps: float, seconds: float) -> str:
        """Write the speed of a number of coupling steps in a number of seconds."""
        if seconds <= 0.0 or steps <= 0:
            return ""
        rate = steps / seconds
        if not self.md_steps:
            return f"{rate:.3g} steps/s"
        md = rate * self.md_steps
        atom_steps = f", {quantity(md * self.atoms)} atom-steps/s" if self.atoms else ""
        return f"{md:,.0f} MD steps/s{atom_steps}"


class Display:
    """Shows the events of the coupler as a bar on a terminal, as lines elsewhere."""

    def __init__(self, console: Console, pace: Pace) -> None:
        self.console = console
        self.pace = pace
        self.start: tuple[float, int] | None = None  # clock and step of the first progress
        self.printed = self.drawn = float("-inf")
        self.estimated = False  # whether a time has been printed that is left
        self.bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=16),
            TextColumn("{task.fields[words]}"),
            console=console,
            auto_refresh=False,  # no thread while processes are forked
            transient=True,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("starting", total=None, words="")

    def __enter__(self) -> Self:
        """Show the bar."""
        self.bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        """Remove the bar."""
        self.bar.stop()

    def event(self, event: Event) -> None:
        """Show one event of the coupler."""
        match event:
            case Registered(who):
                self._note(f"{who} has joined")
            case Reached():
                self._reached(event)
            case Found(_, message):
                self.console.print(f"warning: {message}", style="yellow", markup=False)
            case Waiting(who, seconds):
                self._note(f"waiting for {', '.join(who)} ({seconds:.0f} s)")
            case Lost(who, step, _):
                self._note(f"{who} lost at step {step}")
            case ServiceFailed(who, _, _):
                self._note(f"{who} failed")

    def say(self, text: str) -> None:
        """Show a line above the bar."""
        self.console.print(text)

    def tick(self) -> None:
        """Refresh the bar, a few times a second."""
        if time.monotonic() - self.drawn >= REFRESH:
            self.drawn = time.monotonic()
            self.bar.refresh()

    def _note(self, text: str) -> None:
        if self.console.is_terminal:
            self.bar.update(self.task, words=text)
        else:
            self.console.print(text)

    def _reached(self, event: Reached) -> None:
        now = time.monotonic()
        if self.start is None:
            self.start = (now, event.step)
        seconds, steps = now - self.start[0], event.step - self.start[1]
        words = [f"t = {event.time:.5g} {self.pace.time_unit}"]
        if steps > 0:
            left = seconds / steps * (event.last_step - event.step)
            words += [f"{clock(left)} left", self.pace.speed(steps, seconds)]
        text = ", ".join(words)
        title = f"step {event.step} of {event.last_step}"
        if self.console.is_terminal:
            self.bar.update(
                self.task,
                description=title,
                completed=event.step,
                total=event.last_step,
                words=text,
            )
        elif now - self.printed >= QUIET or not self.estimated or event.step == event.last_step:
            self.printed, self.estimated = now, steps > 0
            self.console.print(f"{title}  {text}")
