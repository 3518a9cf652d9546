"""What the user sees of a run: a progress bar, plain lines, or the services' merged logs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.events import Event, Lost, Registered, ServiceFailed, Waiting
from gimpmd_schemas.wire.events import Progress as Reached

QUIET = 10.0
"""Seconds between two plain lines."""

REFRESH = 0.2
"""Seconds between two pictures of the bar."""

COLOURS = {"coupler": "cyan", "md": "yellow", "gimp": "green"}


@dataclass(frozen=True)
class Pace:
    """Units of work in one coupling step, to speak of speed as each community does."""

    md_steps: int
    atoms: int
    time_unit: str

    @classmethod
    def of(cls, case: Case, atoms: int) -> Pace:
        """Pace of a case; a run of the continuum alone has no MD steps."""
        steps = 0 if case.only == "continuum" else case.md_steps()
        return cls(steps, atoms, UNITS[case.units].time)

    def speed(self, steps: float, seconds: float) -> str:
        """Coupling steps in some seconds as text."""
        if seconds <= 0.0 or steps <= 0:
            return ""
        rate = steps / seconds
        if not self.md_steps:
            return f"{rate:.3g} steps/s"
        md = rate * self.md_steps
        return f"{md:,.0f} MD steps/s, {quantity(md * self.atoms)} atom-steps/s"


def quantity(value: float) -> str:
    """A large number with its SI prefix: ``1.2 M``."""
    for size, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:.3g} {prefix}"
    return f"{value:.3g}"


def clock(seconds: float) -> str:
    """Seconds as ``h:mm:ss``, ``m:ss`` or ``s``."""
    if seconds < 59.5:
        return f"{seconds:.2g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Display:
    """Shows the coupler's events as a bar on a terminal, as lines elsewhere."""

    def __init__(self, console: Console, pace: Pace) -> None:
        self.console = console
        self.pace = pace
        self.began: tuple[float, int] | None = None  # clock and step of the first progress
        self.said = self.drawn = float("-inf")
        self.bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=16),
            TextColumn("{task.fields[words]}"),
            console=console,
            auto_refresh=False,  # no thread while processes are being forked
            transient=True,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("starting", total=None, words="")

    def __enter__(self) -> Self:
        """Begin to draw."""
        self.bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        """Take the bar away."""
        self.bar.stop()

    def event(self, event: Event) -> None:
        """Take note of one word of the coupler."""
        match event:
            case Registered(who):
                self._note(f"{who} has joined")
            case Reached():
                self._reached(event)
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
        """Draw, a few times a second."""
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
        if self.began is None:
            self.began = (now, event.step)
        seconds, steps = now - self.began[0], event.step - self.began[1]
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
        elif now - self.said >= QUIET or event.step == event.last_step:
            self.said = now
            self.console.print(f"{title}  {text}")


class MergedLogs:
    """Shows what all services write, line by line, each with its service's name in front."""

    def __init__(self, console: Console, logs: Mapping[str, Path], display: Display) -> None:
        self.console = console
        self.logs = logs
        self.display = display
        self.read = dict.fromkeys(logs, 0)
        self.rest = dict.fromkeys(logs, b"")

    def event(self, event: Event) -> None:
        """Show events as lines of the coupler."""
        self.display.event(event)

    def say(self, text: str) -> None:
        """Show a line of the supervisor's own."""
        self.display.say(text)

    def tick(self) -> None:
        """Show what the logs have gained."""
        for name, path in self.logs.items():
            try:
                with path.open("rb") as log:
                    log.seek(self.read[name])
                    new = log.read()
            except FileNotFoundError:  # not started yet
                continue
            self.read[name] += len(new)
            *lines, self.rest[name] = (self.rest[name] + new).split(b"\n")
            for line in lines:
                prefix = Text(f"{name:>8} | ", style=COLOURS.get(name, "white"))
                self.console.print(prefix + Text(line.decode(errors="replace")), soft_wrap=True)
        self.display.tick()
