"""The logs of all services in one stream, while a run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.text import Text

from gimpmd_deploy.launch.progress import Display
from gimpmd_schemas.wire.events import Event

COLOURS = {"coupler": "cyan", "md": "yellow", "gimp": "green"}


class MergedLogs:
    """Shows what all services write, line by line, each line after the name of its service."""

    def __init__(self, console: Console, logs: Mapping[str, Path], display: Display) -> None:
        self.console = console
        self.logs = logs
        self.display = display
        self.read = dict.fromkeys(logs, 0)
        self.rest = dict.fromkeys(logs, b"")

    def event(self, event: Event) -> None:
        """Show one event of the coupler."""
        self.display.event(event)

    def say(self, text: str) -> None:
        """Show a message of the supervisor."""
        self.display.say(text)

    def tick(self) -> None:
        """Show the new lines of the logs."""
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
