"""The coupler and the other side, as a service sees them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import Empty
from typing import Any

import numpy as np

from gimpmd_coupler.bus.settings import UNASKED
from gimpmd_coupler.bus.stage import STEP_BYTES, Heard, Stage
from gimpmd_coupler.check.log import RefusalError, UnmetError, expect
from gimpmd_coupler.check.process import Process
from gimpmd_coupler.check.rank import Rank, decoded
from gimpmd_coupler.mapping import links
from gimpmd_coupler.participant import OFFSET, OTHER
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.energies import Energies, total
from gimpmd_schemas.wire.fields import sent_fields
from gimpmd_schemas.wire.messages import (
    Accepted,
    Array,
    Failed,
    Grant,
    Payload,
    Refused,
    Register,
    encode,
)

Fields = Mapping[str, Array]
Peer = Callable[[int], Fields]
"""Gives the fields of the other side at a step, on the nodes that the service needs."""

START_FACTOR = 6.0
"""Factor of the deadline until the second payload: kernels are compiled, potentials are read."""

_POLL_SECONDS = 0.05
_BEHIND = 3  # steps for which a rank keeps its payloads after it has reported them


class Partner:
    """Speaks with all ranks of a service; answers reports while it waits for something else.

    Fields are those of the whole service: payloads of its ranks are put together, and what the
    other side sends is divided among the ranks that are played. Each of these has nodes from
    everywhere, in descending order, so that a service which takes the rows of a payload for its own
    nodes is found out.

    Parameters
    ----------
    stage : Stage
    process : Process
    plan : Plan
        It says how many ranks there are of each role.
    role : Role
        Role of the service.
    run_dir : Path
        Run folder of the service.
    deadline : float
        How long to wait for anything that the service should do (seconds).

    Attributes
    ----------
    ranks : the ranks of the service.
    peers : names of the ranks of the other side; none in a run of one side.
    needs, offers : ids of the nodes of all registrations, ascending.
    tokens : names of the ranks whose tokens exist.
    first, last, granted : first and last step of the run, and the step that is granted.
    asked : steps of the payloads that ranks have asked for again, by the name of the peer.
    failure : what the first rank that fails reports as the reason, or None.
    answers_reports : whether reports are answered.
    """

    def __init__(
        self,
        stage: Stage,
        process: Process,
        plan: Plan,
        role: Role,
        run_dir: Path,
        deadline: float,
    ) -> None:
        self.stage, self.process, self.plan, self.role = stage, process, plan, role
        self.run_dir, self._deadline = run_dir, deadline
        self.ranks = tuple(Rank(role, number) for number in range(plan.ranks(role)))
        self._by_name = {rank.name: rank for rank in self.ranks}
        self.peers = () if plan.only else names(OTHER[role], plan.ranks(OTHER[role]))
        self._scheme = plan.coupling.scheme if plan.coupling else None
        self.needs = self.offers = np.empty(0, dtype=np.int64)
        self._order = np.empty(0, dtype=np.int64)  # of `offers` in the nodes of all ranks
        self.tokens: set[str] = set()
        self.first = self.last = self.granted = -1
        self.asked: dict[str, list[int]] = {peer: [] for peer in self.peers}
        self.failure: Failed | None = None
        self.answers_reports, self._bears_failure = True, False
        self._recalled = False
        self._checkpoints: tuple[int, ...] = ()
        self._steps = 0  # how far `play` has come

    # What the service does

    def wait_for(self, met: Callable[[], Any], what: str, seconds: float | None = None) -> None:
        """Take what comes until a condition is met.

        Raises
        ------
        UnmetError
            It is not met in time, or the service ends first.
        """
        seconds = self._deadline if seconds is None else seconds
        until = time.monotonic() + seconds
        while not met():
            if not self._take_next() and self.process.code is not None and not met():
                raise UnmetError(what, self.process.state())
            if time.monotonic() > until:
                raise UnmetError(what, f"nothing of the kind within {seconds:g} s")

    def listen(self, seconds: float) -> None:
        """Take what comes for some time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._take_next()

    def wait_for_end(self, code: int, seconds: float | None = None) -> None:
        """Wait for the end of the service with an exit code.

        With several ranks the code is that of ``mpiexec``. It may be another one than that of the
        ranks, but not 0 if they have failed.

        Raises
        ------
        UnmetError
            It does not end in time, or with another code.
        """
        self._bears_failure = True
        any_failure = code != 0 and len(self.ranks) > 1
        wanted = "any exit code but 0" if any_failure else f"exit code {code}"
        wanted = f"the end of the service with {wanted}"
        self.wait_for(lambda: self.process.code is not None, wanted, seconds)
        fits = self.process.code != 0 if any_failure else self.process.code == code
        expect(fits, wanted, self.process.state())

    def register(self) -> list[Register]:
        """Wait for the registrations of all ranks.

        Raises
        ------
        UnmetError
            One does not come, or cannot be read.
        RefusalError
            The service refuses the plan.
        """
        for rank in self.ranks:
            self.wait_for(
                lambda rank=rank: rank.registrations,  # type: ignore[misc]
                f"a request Register on the key of {rank.name}",
                START_FACTOR * self._deadline,
            )
        size = self.plan.background_grid().size
        found = [rank.registration(size) for rank in self.ranks]
        self.take_nodes()
        return found

    def take_nodes(self) -> None:
        """Put the nodes of the ranks together."""
        offers = np.concatenate([rank.offers for rank in self.ranks])
        self._order = np.argsort(offers, kind="stable")
        self.offers = offers[self._order]
        self.needs = np.unique(np.concatenate([rank.needs for rank in self.ranks]))

    def sent(self, step: int) -> bool:
        """Whether any rank has sent the payload of a step."""
        return any(step in rank.frames for rank in self.ranks)

    def payload(self, step: int) -> Fields:
        """Wait for the payloads of a step, and return the fields of all ranks on ``offers``.

        Raises
        ------
        UnmetError
            One does not come, or its fields do not fit the nodes.
        """
        seconds = (START_FACTOR if step <= self.first + 1 else 1.0) * self._deadline
        senders = [rank for rank in self.ranks if rank.offers.size]
        for rank in senders:
            what = f"the payload of step {step}" + (f" of {rank.name}" * (len(self.ranks) > 1))
            self.wait_for(lambda rank=rank: step in rank.frames, what, seconds)  # type: ignore[misc]
        parts = [self._fields(rank, rank.frames[step][0]) for rank in senders]
        return {
            name: np.concatenate([part[name] for part in parts])[self._order] for name in parts[0]
        }

    @property
    def steps(self) -> list[int]:
        """Steps whose payloads all ranks with nodes have sent."""
        sent = [set(rank.frames) for rank in self.ranks if rank.offers.size]
        return sorted(set.intersection(*sent))

    @property
    def reported(self) -> int:
        """The last step that all ranks have reported."""
        return min(rank.reported for rank in self.ranks)

    def energies(self, step: int) -> Energies | None:
        """Sums of what the ranks have reported at a step; None if one has reported nothing."""
        return total([rank.energies.get(step) for rank in self.ranks])

    # What the service is told

    def accept(self, last: int, granted: int, first: int = 0) -> None:
        """Answer the registrations."""
        self.first, self.last, self.granted = first, last, granted
        self._steps = first
        offers = {number: self._nodes_of(number) for number in range(len(self.peers))}
        for rank in self.ranks:
            rank.reported = first - 1
            rank.links = links(rank.name, rank.needs, offers, OTHER[self.role])
            arrays: dict[str, Array] = {}
            for number, link in rank.links.items():
                arrays |= {f"rows_{number}": link.rows, f"places_{number}": link.places}
            message = Accepted(
                first_step=first, last_step=last, granted=granted, sources=tuple(rank.links)
            )
            for request in rank.registrations:  # it may have asked again
                self.stage.answer(rank.name, encode(message, arrays), request.number)

    def _nodes_of(self, number: int) -> Ints:
        """Nodes of a rank of the other side: every so-many-th, in descending order."""
        return self.needs[self._rows_of(number)]

    def _rows_of(self, number: int) -> slice:
        count = len(self.peers)
        last = self.needs.size - 1 - (self.needs.size - 1 - number) % count
        return slice(last, number - 1 if number else None, -count)

    def refuse(self, reason: str, lost: str = "") -> None:
        """Refuse all requests; also tell the ranks without being asked."""
        frame = encode(Refused(reason=reason, lost=lost))
        for rank in self.ranks:
            asked = {*(request.number for request in rank.registrations), rank.pending} - {b""}
            for number in asked:
                self.stage.answer(rank.name, frame, number)
            self.stage.answer(rank.name, frame)

    def grant(self, granted: int, checkpoints: tuple[int, ...] = ()) -> None:
        """Grant steps from now on, and answer reports that wait for it."""
        self.granted, self._checkpoints = granted, checkpoints
        self._answer_reports()

    def recall(self) -> None:
        """Take the grants back."""
        self._recalled = True
        for rank in self.ranks:
            self.stage.answer(rank.name, encode(self._grant()), rank.pending or UNASKED)
            rank.pending = b""

    def end_at(self, last: int) -> None:
        """End the run at a step, after a recall."""
        self.last = self.granted = last
        self._recalled = False
        self._answer_reports()

    def send(self, step: int, fields: Fields) -> None:
        """Send the payloads of the other side at a step."""
        for number in range(len(self.peers)):
            self.send_of(number, step, fields)

    def send_of(self, number: int, step: int, fields: Fields) -> None:
        """Send the payload of one rank of the other side."""
        self.stage.send(self.peers[number], self.frame_of(number, step, fields))

    def frame_of(self, number: int, step: int, fields: Fields) -> bytes:
        """Frame with the part of the fields that a rank of the other side has."""
        rows = self._rows_of(number)
        part = {name: np.ascontiguousarray(field[rows]) for name, field in fields.items()}
        return encode(Payload(role=OTHER[self.role], rank=number, step=step), part)

    def source(self, step: int) -> int:
        """Step of the payload of the other side that the service takes at a step."""
        return step + OFFSET[self.role]

    def play(self, peer: Peer, until: int) -> None:
        """Take the payloads of the service up to a step, and send it those of the other side."""
        for step in range(self._steps, until + 1):
            self.payload(step)
            if self.source(step) <= self.last:
                self.send(self.source(step), peer(self.source(step)))
        self._steps = max(self._steps, until + 1)

    def finish(self, peer: Peer) -> None:
        """Play up to the last step, and wait for the reports of it."""
        self.play(peer, self.last)
        self.wait_for(lambda: self.reported == self.last, f"the report of step {self.last}")

    # Messages

    def _take_next(self) -> bool:
        """Take one message; returns whether there was one."""
        try:
            heard = self.stage.heard.get(timeout=_POLL_SECONDS)
        except Empty:
            return False
        if heard.kind == "again":
            self.asked[heard.who].append(int.from_bytes(heard.data[:STEP_BYTES], "little"))
            return True
        expect(
            heard.who in self._by_name,
            f"messages of {' and '.join(self._by_name)}",
            f"{heard.kind!r} on the key of {heard.who}",
        )
        self._take(heard, self._by_name[heard.who])
        return True

    def _take(self, heard: Heard, rank: Rank) -> None:
        if heard.kind == "alive":
            self.tokens.add(rank.name)
        elif heard.kind == "gone":
            self.tokens.discard(rank.name)
        elif heard.kind == "register":
            rank.registrations.append(heard)
        elif heard.kind == "data":
            rank.take_payload(heard, self.first)
        elif heard.kind == "report":
            rank.take_report(heard)
            self._answer_reports()
        elif heard.kind == "failed":
            self._take_failure(heard, rank)

    def _take_failure(self, heard: Heard, rank: Rank) -> None:
        failure, _ = decoded(heard.data, Failed)
        self.failure = self.failure or failure
        self.stage.answer(rank.name, encode(Refused(reason=failure.message)), heard.number)
        if self._bears_failure:
            return
        if failure.exit_code == InputError.exit_code and self.first < 0:
            raise RefusalError(failure.message)
        raise UnmetError("no failure", f"the request Failed: {failure.message}")

    def bear_failure(self) -> None:
        """From now on the service may report a failure."""
        self._bears_failure = True

    def _answer_reports(self) -> None:
        """Answer the reports of ranks that may advance, or of all if the run ends."""
        for rank in self.ranks:
            if rank.pending and self.answers_reports and self._may_answer(rank):
                self.stage.answer(rank.name, encode(self._grant()), rank.pending)
                rank.pending = b""

    def _may_answer(self, rank: Rank) -> bool:
        if rank.reported >= self.last:
            return self.reported >= self.last
        if self._recalled:  # a report that was sent before the rank knew of it
            return rank.holds is None
        return self.granted >= rank.reported + 2 or self.granted == self.last

    def _grant(self) -> Grant:
        done = self.last if self.reported >= self.last else self.reported - _BEHIND
        return Grant(
            granted=self.granted,
            last=self.last,
            done=max(done, self.first - 1),
            recall=self._recalled,
            checkpoints=self._checkpoints,
        )

    def _fields(self, rank: Rank, frame: bytes) -> Fields:
        """The fields of a payload of a rank; see `payload`."""
        message, arrays = decoded(frame, Payload)
        for field in sent_fields(self.role, self._scheme) if self._scheme else ():
            shape = (rank.offers.size, *field.shape(self.plan.dim))
            array = arrays.get(field.name)
            wanted = f"{field.name!r} as float64 of shape {shape} at step {message.step}"
            expect(array is not None, wanted, f"a payload with {sorted(arrays)}")
            assert array is not None
            expect(
                array.dtype == np.float64 and array.shape == shape,
                wanted,
                f"{array.dtype} of shape {array.shape}",
            )
            expect(
                bool(np.isfinite(array).all()), f"{wanted}, finite", "numbers that are not finite"
            )
        return arrays


def names(role: Role, count: int) -> tuple[str, ...]:
    """Names of the ranks of a role."""
    return tuple(f"{role}/{number}" for number in range(count))
