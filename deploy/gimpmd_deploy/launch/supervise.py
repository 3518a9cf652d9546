"""Local processes of a run: start them, watch them, end them; none is left behind.

Should the supervisor itself be killed, the coupler's standard input ends, which to the coupler
means ``stop``; and services end when the coupler does.
"""

from __future__ import annotations

import os
import re
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec
import psutil

from gimpmd_schemas.errors import BackendError, GimpmdError, PeerLostError
from gimpmd_schemas.wire.events import Ended, Event, Listening, Lost, Progress, ServiceFailed

_NOISE = re.compile(r"^=|^YOUR APPLICATION|^This typically|^Please see the FAQ| INFO ")
"""Log lines that are no error: notes of progress, and the banner of mpiexec."""

TICK = 0.05
"""Seconds between two looks at the processes."""


@dataclass(frozen=True)
class Deadlines:
    """How long the supervisor waits (seconds).

    Attributes
    ----------
    listen : for the coupler to open the bus.
    stop : for the run to end at its next step after Ctrl-C.
    leave : for the processes to end once the run has.
    grace : after a failure, for the coupler to name the culprit and for all to end themselves.
    terminate, kill : after SIGTERM, and after SIGKILL. With ``grace`` less than 5 s in all.
    """

    listen: float = 60.0
    stop: float = 20.0
    leave: float = 30.0
    grace: float = 2.0
    terminate: float = 1.5
    kill: float = 1.0


ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
"""For all services: idle threads of OpenMP and BLAS spin, and would take cores from LAMMPS."""


@dataclass(frozen=True)
class Service:
    """How to start one service: its command, and the log that takes its output."""

    name: str
    argv: Sequence[str]
    log: Path
    cwd: Path


@dataclass(frozen=True)
class Outcome:
    """How far a run came; ``stopped`` if before its end time, ``forced`` if not by itself."""

    step: int
    time: float
    stopped: bool
    forced: bool = False


class Watcher(Protocol):
    """Whoever shows the run to the user."""

    def event(self, event: Event) -> None:
        """Take note of one word of the coupler."""

    def say(self, text: str) -> None:
        """Show a line of the supervisor's own."""

    def tick(self) -> None:
        """Draw, if it is time to."""


@dataclass(frozen=True)
class Child:
    """A started service."""

    service: Service
    process: subprocess.Popen[bytes]

    @property
    def name(self) -> str:
        """Name of the service."""
        return self.service.name

    def running(self) -> bool:
        """Whether it still runs; reaps it if not."""
        return self.process.poll() is None

    def failed(self) -> bool:
        """Whether it has ended, and not well."""
        return self.process.poll() not in (None, 0)

    def how(self) -> str:
        """In words how it ended, with its own last words."""
        code = self.process.returncode
        text = f"was killed by {signal.Signals(-code).name}" if code < 0 else ""
        text = text or f"ended with exit code {code}"
        words = last_words(self.service.log)
        return f"{text}\n{words}" if words else text


def last_words(log: Path, lines: int = 6) -> str:
    """The end of a log without traceback bodies and what is no error: its own message."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 16384))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    said = text.splitlines()
    tracebacks = [i for i, line in enumerate(said) if line.startswith("Traceback")]
    if tracebacks:
        said = [line for line in said[tracebacks[-1] + 1 :] if not line.startswith(" ")]
    kept = [line.rstrip() for line in said if line.strip() and not _NOISE.search(line)]
    if not kept:
        return ""
    return f"last words in {log}:\n" + "\n".join(f"    {line}" for line in kept[-lines:])


def start(service: Service, talks: bool = False) -> Child:
    """Start a service in a session of its own, so that Ctrl-C reaches the supervisor alone.

    Parameters
    ----------
    talks : keep its standard input and output as pipes; else its output goes to its log.

    Raises
    ------
    PeerLostError
        The command cannot be started.
    """
    service.log.parent.mkdir(parents=True, exist_ok=True)
    with service.log.open("ab") as log:
        try:
            process = subprocess.Popen(
                list(service.argv),
                cwd=service.cwd,
                env=os.environ | ENVIRONMENT,
                stdin=subprocess.PIPE if talks else subprocess.DEVNULL,
                stdout=subprocess.PIPE if talks else log,
                stderr=log,
                start_new_session=True,
            )
        except OSError as error:
            reason = error.strerror or str(error)
            raise PeerLostError(f"{service.name} cannot be started: {reason}") from None
    return Child(service, process)


def end_all(children: Sequence[Child], deadlines: Deadlines) -> None:
    """End all processes and their descendants: SIGTERM, then SIGKILL."""
    family: list[psutil.Process] = []
    for child in children:
        if child.running():
            with suppress(psutil.NoSuchProcess):
                family += psutil.Process(child.process.pid).children(recursive=True)
    for number, patience in (
        (signal.SIGTERM, deadlines.terminate),
        (signal.SIGKILL, deadlines.kill),
    ):
        alive = [child for child in children if child.running()]
        for child in children:
            if child.running() or child.failed():  # its group may outlive a leader that crashed
                with suppress(ProcessLookupError):
                    os.killpg(child.process.pid, number)
        if not alive:
            break
        limit = time.monotonic() + patience
        while any(child.running() for child in alive) and time.monotonic() < limit:
            time.sleep(TICK)
    for process in psutil.wait_procs(family, timeout=0.2)[1]:
        with suppress(psutil.NoSuchProcess):
            process.kill()


class _Coupler:
    """The coupler's side of the talk: events in, ``stop`` out."""

    def __init__(self, child: Child) -> None:
        assert child.process.stdout is not None
        self.child = child
        self.pipe = child.process.stdout
        self.rest = b""
        self.decoder = msgspec.json.Decoder(Event)
        os.set_blocking(self.pipe.fileno(), False)
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.pipe, selectors.EVENT_READ)

    def events(self, patience: float) -> Iterator[Event]:
        """Events that arrive within ``patience`` seconds; what is none goes to the log."""
        if not self.selector.get_map():
            time.sleep(patience)
            return
        if not self.selector.select(patience):
            return
        chunk = self.pipe.read(1 << 20)
        if chunk == b"":  # end of file: the coupler is gone
            self.selector.unregister(self.pipe)
        *lines, self.rest = (self.rest + (chunk or b"")).split(b"\n")
        for line in lines:
            try:
                yield self.decoder.decode(line)
            except msgspec.DecodeError:
                with self.child.service.log.open("ab") as log:
                    log.write(line + b"\n")

    def stop(self) -> None:
        """Ask the run to end at its next step."""
        stdin = self.child.process.stdin
        with suppress(OSError):  # it may be gone already
            if stdin is not None:
                stdin.write(b"stop\n")
                stdin.flush()

    def close(self) -> None:
        """Close the pipes."""
        self.selector.close()
        for pipe in (self.child.process.stdin, self.pipe):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Signals that ask for an end, collected in a list instead of raised."""
    seen: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
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
) -> Outcome:
    """Run the coupler and its services to the end; whatever happens, no process is left.

    Parameters
    ----------
    coupler : Service
        Prints events on its standard output and takes ``stop`` on its standard input.
    services : callable
        Gives the services to start once the coupler listens on an endpoint.
    watcher : Watcher

    Returns
    -------
    Outcome

    Raises
    ------
    BackendError
        A service refused its input (exit code 2).
    PeerLostError
        A process died, fell silent or did not end; the message names the culprit.
    """
    run = _Run(services, watcher, deadlines or Deadlines())
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
    ) -> None:
        self.services = services
        self.watcher = watcher
        self.deadlines = deadlines
        self.children: list[Child] = []
        self.deaths: list[Child] = []  # in the order they were seen, the coupler first of equals
        self.trouble: Lost | ServiceFailed | None = None
        self.ended: Ended | None = None
        self.reached: Progress | None = None
        self.limit = float("inf")
        self.overdue = ""
        self.timed_out = False

    def start(self, coupler: Service) -> None:
        self.children.append(start(coupler, talks=True))
        self.talk = _Coupler(self.children[0])
        within = self.deadlines.listen
        self._expect(within, f"{coupler.name} did not open the bus within {within:g} s")

    def _expect(self, within: float, reason: str) -> None:
        """Set the deadline for what should happen next, and what to say if it does not."""
        self.limit, self.overdue = time.monotonic() + within, reason

    def watch(self, interrupts: Sequence[int]) -> None:
        """Look after the processes until all have ended, or a deadline passes."""
        asked = 0
        while any(child.running() for child in self.children):
            self._listen(TICK)
            self.watcher.tick()
            self._count_the_dead()
            if len(interrupts) > asked:
                asked = len(interrupts)
                if asked > 1:
                    return
                self.watcher.say("stopping at the next step; Ctrl-C again ends it at once")
                self.talk.stop()
                within = self.deadlines.stop
                self._expect(within, f"the run did not stop within {within:g} s")
            if time.monotonic() > self.limit:
                self.timed_out = True
                return

    def _listen(self, patience: float) -> None:
        for event in self.talk.events(patience):
            self.watcher.event(event)
            match event:
                case Listening(endpoint):
                    self.limit = float("inf")
                    for service in self.services(endpoint):
                        self.children.append(start(service))
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

    def _count_the_dead(self) -> None:
        new = [child for child in self.children if child.failed() and child not in self.deaths]
        if new and not self.deaths and self.trouble is None:
            self._expect(self.deadlines.grace, "")
        self.deaths += new
        gone = [child.name for child in self.children if not child.running()]
        if gone and self.limit == float("inf"):
            self._expect(self.deadlines.leave, f"the run did not end although {gone[0]} had")

    def end(self) -> None:
        """End what still runs, and hear what the coupler said last."""
        self.late = [child.name for child in self.children if child.running()]
        end_all(self.children, self.deadlines)
        if self.children:
            self._listen_to_the_end()
            self.talk.close()

    def _listen_to_the_end(self) -> None:
        before = self.trouble
        self.services = lambda _: ()  # too late to start any
        while self.talk.selector.get_map() and self.talk.selector.select(0.0):
            self._listen(0.0)
        if self.late:  # what it noticed since is the supervisor's own doing
            self.trouble = before

    def outcome(self, interrupted: bool) -> Outcome:
        """What the run came to; raises what went wrong."""
        if self.trouble is not None and not (interrupted and self.ended):
            raise self._told_by_coupler(self.trouble)
        if self.ended is not None and not self.deaths and not self.late:
            return Outcome(self.ended.step, self.ended.time, self.ended.stopped)
        if interrupted:
            reached = self.ended or self.reached
            step, at = (reached.step, reached.time) if reached else (0, 0.0)
            return Outcome(step, at, stopped=True, forced=True)
        if self.deaths:
            raise self._seen(self.deaths[0])
        if self.ended is not None:
            raise PeerLostError(f"{', '.join(self.late)} {self.overdue}; it was killed")
        if self.timed_out:
            words = last_words(self.children[0].service.log)
            raise PeerLostError(f"{self.overdue}\n{words}".rstrip())
        words = last_words(self.children[0].service.log)
        raise PeerLostError(f"the coupler ended without a word about the run\n{words}".rstrip())

    def _told_by_coupler(self, trouble: Lost | ServiceFailed) -> GimpmdError:
        if isinstance(trouble, ServiceFailed):
            kind = BackendError if trouble.exit_code == 2 else PeerLostError
            return kind(f"{trouble.who}: {trouble.message}")
        text = f"{trouble.who} was lost at step {trouble.step}: {trouble.reason}"
        service = trouble.who.split("/")[0].split(" ")[0]
        for child in self.deaths:
            if child.name == service:
                text += f"\n{child.name} {child.how()}"
        return PeerLostError(text)

    def _seen(self, child: Child) -> GimpmdError:
        kind = BackendError if child.process.returncode == 2 else PeerLostError
        at = f" at step {self.reached.step}" if self.reached else " before the first step"
        return kind(f"{child.name} was lost{at}: it {child.how()}")


def mpiexec() -> str:
    """The ``mpiexec`` of the environment that this Python belongs to.

    Raises
    ------
    BackendError
        There is none.
    """
    path = Path(sys.executable).parent / "mpiexec"
    if not path.exists():
        raise BackendError(f"no mpiexec in {path.parent}: install MPICH there, pip install mpich")
    return str(path)
