"""Supervision of a run: its processes are started, watched and ended, and none is left behind.

If the supervisor itself is killed, the standard input of the coupler is closed. The coupler takes
that as ``stop``, and the services end when the coupler does.

The coupler names the ranks that are lost. The supervisor sees what the coupler cannot: a service
that ends before its ranks have registered, which it tells the coupler; and the coupler's own death
or silence.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from gimpmd_deploy.launch.coupler_pipe import CouplerPipe
from gimpmd_deploy.launch.processes import TICK, Child, Service, end_all, last_words, start
from gimpmd_deploy.launch.services import NAMES
from gimpmd_schemas.errors import BackendError, GimpmdError, PeerLostError
from gimpmd_schemas.wire.access import UNIX
from gimpmd_schemas.wire.events import Alive, Ended, Event, Listening, Lost, Progress, ServiceFailed


@dataclass(frozen=True)
class Deadlines:
    """How long the supervisor waits (seconds).

    Attributes
    ----------
    listen : until the coupler opens the bus.
    stop : after Ctrl-C, until the run ends at its next step.
    leave : after the end of the run, until the processes end.
    grace : after a failure, until the coupler names the culprit and the processes end themselves.
    terminate, kill : after SIGTERM, and after SIGKILL. Together with ``grace`` less than 5 s.
    silence : without a sign of life of the coupler, which gives one twice a second.
    suspicion : the same if its process is stopped, or a service has ended: ranks end when the
        coupler is frozen.
    """

    listen: float = 60.0
    stop: float = 20.0
    leave: float = 30.0
    grace: float = 2.0
    terminate: float = 1.5
    kill: float = 1.0
    silence: float = 10.0
    suspicion: float = 3.0


@dataclass(frozen=True)
class Outcome:
    """How far a run came.

    Attributes
    ----------
    step, time : the last step.
    stopped : whether it ended before its end time.
    forced : whether processes were killed.
    defect : text for the user, if a finding ended the run.
    """

    step: int
    time: float
    stopped: bool
    forced: bool = False
    defect: str = ""


_LONGEST_TURN = 0.5
"""Seconds that one turn of the supervisor takes at most, unless it was stopped itself."""


class Watcher(Protocol):
    """Shows the run to the user."""

    def event(self, event: Event) -> None:
        """Take one event of the coupler."""

    def say(self, text: str) -> None:
        """Show a message of the supervisor."""

    def tick(self) -> None:
        """Refresh the display if it is due; called several times a second."""


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Signals that ask the run to end, collected in a list instead of raised.

    Python lets only the main thread catch signals; in other threads the list stays empty.
    """
    seen: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda number, _: seen.append(number)) for number in numbers]
    try:
        yield seen
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def supervise(
    coupler: Service,
    services: Callable[[str], Sequence[Service]],
    watcher: Watcher,
    deadlines: Deadlines | None = None,
    inherits: Sequence[int] = (),
) -> Outcome:
    """Run the coupler and its services to the end; whatever happens, no process is left behind.

    Parameters
    ----------
    coupler : Service
        Prints events on its standard output and takes ``stop`` on its standard input.
    services : callable
        Takes the endpoint on which the coupler listens; returns the services to start.
    watcher : Watcher
    deadlines : Deadlines, optional
    inherits : sequence of int
        File descriptors that all processes keep open.

    Returns
    -------
    Outcome

    Raises
    ------
    BackendError
        A service refused its input (exit code 2).
    PeerLostError
        A process died, stopped answering or did not end; the message names it.
    """
    run = _Run(services, watcher, deadlines or Deadlines(), inherits)
    with _interrupts() as interrupts:
        try:
            run.start(coupler)
            run.watch(interrupts)
        finally:
            run.end()
    return run.outcome(bool(interrupts))


class _Run:
    """State of one supervised run."""

    def __init__(
        self,
        services: Callable[[str], Sequence[Service]],
        watcher: Watcher,
        deadlines: Deadlines,
        inherits: Sequence[int],
    ) -> None:
        self.services = services
        self.watcher = watcher
        self.deadlines = deadlines
        self.inherits = inherits
        self.children: list[Child] = []
        self.deaths: list[Child] = []  # in the order they were seen, the coupler first of equals
        self.trouble: Lost | ServiceFailed | None = None
        self.ended: Ended | None = None
        self.reached: Progress | None = None
        self.endpoint = ""  # of the bus, once it is open
        self.limit = float("inf")
        self.overdue = ""
        self.timed_out = False
        self.told: set[str] = set()  # services of whose end the coupler knows
        self.silent: float | None = None  # seconds since a sign of life, once there was one
        self.silence = ""  # the same as text, if that is too long

    def start(self, coupler: Service) -> None:
        self.children.append(start(coupler, True, self.inherits))
        self.pipe = CouplerPipe(self.children[0])
        within = self.deadlines.listen
        self._expect(within, f"{coupler.name} did not open the bus within {within:g} s")

    def _expect(self, within: float, reason: str) -> None:
        """Set the deadline for the next event, and the message if it is missed."""
        self.limit, self.overdue = time.monotonic() + within, reason

    def watch(self, interrupts: Sequence[int]) -> None:
        """Watch the processes until all have ended, or a deadline passes."""
        asked, now = 0, time.monotonic()
        while any(child.running() for child in self.children):
            # This process may be stopped for minutes (Ctrl-Z) at any place. Meanwhile events wait
            # in the pipe, so deadlines are compared with a time before they are read.
            before, now = now, time.monotonic()
            if self.silent is not None:
                self.silent += min(now - before, _LONGEST_TURN)
            self._read_events(TICK)
            self.watcher.tick()
            self._note_failures()
            if len(interrupts) > asked:
                asked = len(interrupts)
                if asked > 1:
                    return
                self.watcher.say(
                    "stopping at the next step; press Ctrl-C again to end the run at once"
                )
                self.pipe.stop()
                within = self.deadlines.stop
                self._expect(within, f"the run did not stop within {within:g} s")
            self._note_silence()
            if now > self.limit:
                self.timed_out = True
                return
            if self.silence and not self.deaths:
                return

    def _read_events(self, patience: float) -> None:
        for event in self.pipe.events(patience):
            self.watcher.event(event)
            match event:
                case Listening(endpoint):
                    self.limit, self.endpoint = float("inf"), endpoint
                    for service in self.services(endpoint):
                        self.children.append(start(service, inherits=self.inherits))
                case Alive():
                    self.silent = 0.0
                case Progress():
                    self.reached = event
                case Lost() | ServiceFailed():
                    if self.trouble is None:
                        self.trouble = event
                        self._expect(self.deadlines.grace, "")
                case Ended():
                    self.ended = event
                    within = self.deadlines.leave
                    self._expect(within, f"did not end within {within:g} s after the run")

    def _note_failures(self) -> None:
        new = [child for child in self.children if child.failed() and child not in self.deaths]
        if new and not self.deaths and self.trouble is None:
            self._expect(self.deadlines.grace, "")
        self.deaths += new
        gone = [child for child in self.children if not child.running()]
        if gone and self.limit == float("inf"):
            self._expect(self.deadlines.leave, f"the run did not end although {gone[0].name} did")
        for child in gone:
            if self.ended is None and child.name not in self.told:
                self.told.add(child.name)
                self.pipe.lost(child.name, f"it {child.how()}")

    def _note_silence(self) -> None:
        """Note whether the coupler has given no sign of life for too long."""
        coupler, seconds = self.children[0], self.silent or 0.0
        self.silence = ""
        if seconds <= self.deadlines.suspicion or not coupler.running():
            return
        state = coupler.state()
        if self.deaths or state == "stopped" or seconds > self.deadlines.silence:
            self.silence = f"its process is {state} and gave no sign of life for {seconds:.1f} s"

    def end(self) -> None:
        """End the processes that still run, and read the last events of the coupler."""
        self.late = [child.name for child in self.children if child.running()]
        end_all(self.children, self.deadlines.terminate, self.deadlines.kill)
        if self.children:
            self._read_last_events()
            self.pipe.close()
        _remove_socket(self.endpoint)

    def _read_last_events(self) -> None:
        before = self.trouble
        self.services = lambda _: ()  # it is too late to start any
        while self.pipe.has_events():
            self._read_events(0.0)
        if self.late:  # later failures were caused by the supervisor
            self.trouble = before

    def outcome(self, interrupted: bool) -> Outcome:
        """Return how the run ended, or raise what went wrong."""
        if self.trouble is not None and not (interrupted and self.ended):
            raise self._reported_by_coupler(self.trouble)
        if self.ended is not None and not self.deaths and not self.late:
            ended = self.ended
            return Outcome(ended.step, ended.time, ended.stopped, defect=ended.defect)
        if interrupted:
            reached = self.ended or self.reached
            step, at = (reached.step, reached.time) if reached else (0, 0.0)
            return Outcome(step, at, stopped=True, forced=True)
        if self.silence:
            raise PeerLostError(f"coupler was lost{self._where()}: {self.silence}")
        if self.deaths:
            raise self._error_of(self.deaths[0])
        if self.ended is not None:
            raise PeerLostError(f"{', '.join(self.late)} {self.overdue}; it was killed")
        if self.timed_out:
            words = last_words(self.children[0].service.log)
            raise PeerLostError(f"{self.overdue}\n{words}".rstrip())
        words = last_words(self.children[0].service.log)
        raise PeerLostError(f"the coupler ended without saying how the run went\n{words}".rstrip())

    def _reported_by_coupler(self, trouble: Lost | ServiceFailed) -> GimpmdError:
        if isinstance(trouble, ServiceFailed):
            kind = BackendError if trouble.exit_code == 2 else PeerLostError
            return kind(f"{trouble.who}: {trouble.message}")
        names = {role: name for role, name in NAMES.items() if trouble.who.startswith(f"{role}/")}
        for child in self.children:
            if child.name == trouble.who and child.name in self.told:  # the supervisor's own word
                return self._error_of(child)
        text = f"{trouble.who} was lost at step {trouble.step}: {trouble.reason}"
        for child in self.deaths:
            if child.name in names.values():
                text += f"\n{child.name} {child.how()}"
        return PeerLostError(text)

    def _error_of(self, child: Child) -> GimpmdError:
        kind = BackendError if child.process.returncode == 2 else PeerLostError
        return kind(f"{child.name} was lost{self._where()}: it {child.how()}")

    def _where(self) -> str:
        return f" at step {self.reached.step}" if self.reached else " before the first step"


def _remove_socket(endpoint: str) -> None:
    """Remove the socket of the bus and its folder, which a coupler that is killed leaves behind."""
    kind, _, place = endpoint.partition("/")
    if kind == UNIX:
        socket = Path(place)
        for path in (socket, socket.with_name(f"{socket.name}.lock")):
            path.unlink(missing_ok=True)
        with suppress(OSError):  # the coupler has removed it
            socket.parent.rmdir()
