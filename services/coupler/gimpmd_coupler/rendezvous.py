"""The lockstep of the ranks: which answer waits for which parts. Pure logic, no network.

A rank sends its part of step k. It is answered as soon as all parts are there on which the answer
depends. A table, the schedule, says which parts these are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Directive

Part = TypeVar("Part")
Member = tuple[Role, int]
"""A rank of a role."""


@dataclass(frozen=True)
class Source:
    """The answer to step k holds the parts of ``role`` for step ``k + offset``; offset >= 0."""

    role: Role
    offset: int


Schedule = Mapping[Role, Source | None]

SERIAL: Schedule = {"md": Source("continuum", 1), "continuum": Source("md", 0)}
"""Serial staggered coupling: the continuum steps first, then the atoms follow its velocities."""


def name(member: Member) -> str:
    """Name of a rank in messages and logs, such as ``md/0``."""
    return f"{member[0]}/{member[1]}"


@dataclass(frozen=True)
class Answer:
    """An answer that can be sent: to which rank, and the parts ``(role, step)`` that it holds."""

    member: Member
    step: int
    directive: Directive
    source: tuple[Role, int] | None


class Rendezvous(Generic[Part]):
    """Collects parts and determines which requests can be answered.

    Invariants: every rank goes through the steps one by one. Each step has one answer, however
    often a rank asks (parts are kept until no rank can ask for them again). All ranks of all roles
    end at the same step.

    Parameters
    ----------
    ranks : mapping of role to its number of ranks
    schedule : the parts on which the answers to each role depend; None in a run of one side
    first, last : int
        First and last step. At the last step all ranks are told to stop.
    """

    def __init__(
        self, ranks: Mapping[Role, int], schedule: Schedule, first: int, last: int
    ) -> None:
        self.last = last
        self._ranks = ranks
        self._schedule = schedule
        self._answered: dict[Member, int] = {
            (role, rank): first - 1 for role, count in ranks.items() for rank in range(count)
        }
        self._waiting: dict[Member, int] = {}
        self._parts: dict[tuple[Role, int], dict[int, Part]] = {}

    def submit(self, member: Member, step: int, part: Part) -> list[Answer]:
        """Take the part of a rank. A repeated part changes nothing.

        Parameters
        ----------
        member : Member
        step : int
        part : the data of the rank at this step.

        Returns
        -------
        list of Answer
            The requests of all ranks that can now be answered.

        Raises
        ------
        ProtocolError
            The step is neither the next one of this rank nor a repetition of its last one.
        """
        self.check(member, step)
        if self._repeats(member, step):
            return [self._answer(member, step)]
        self._parts.setdefault((member[0], step), {}).setdefault(member[1], part)
        self._waiting[member] = step
        return self._release()

    def check(self, member: Member, step: int) -> None:
        """Raise ProtocolError if the step is neither the next one of the rank nor a repetition."""
        expected = self._waiting.get(member, self._answered[member] + 1)
        if not self._repeats(member, step) and (step != expected or step > self.last):
            state = "has been told to stop" if expected > self.last else f"is at step {expected}"
            raise ProtocolError(f"{name(member)} sends step {step} but {state}")

    def stop(self) -> list[Answer]:
        """End the run at the first step beyond which no rank has been told to advance.

        Returns
        -------
        list of Answer
            Requests that can now be answered.
        """
        self.last = min(self.last, max(self._answered.values()) + 1)
        return self._release()

    def is_complete(self, step: int) -> bool:
        """Whether all ranks of all roles have sent their parts of a step."""
        return all(self._has_all(role, step) for role in self._ranks)

    def parts(self, role: Role, step: int) -> list[Part]:
        """Return the parts of a role at a complete step, in the order of its ranks."""
        parts = self._parts[role, step]
        return [parts[rank] for rank in range(self._ranks[role])]

    def finished(self) -> bool:
        """Whether all ranks have been told to stop."""
        return all(step == self.last for step in self._answered.values())

    def awaited(self) -> list[Member]:
        """Ranks that are computing; all others wait for them or have been told to stop."""
        return [
            member
            for member, step in self._answered.items()
            if step < self.last and member not in self._waiting
        ]

    def _repeats(self, member: Member, step: int) -> bool:
        return step == self._answered[member] and (member[0], step) in self._parts

    def _has_all(self, role: Role, step: int) -> bool:
        return len(self._parts.get((role, step), ())) == self._ranks[role]

    def _answer(self, member: Member, step: int) -> Answer:
        source = self._schedule[member[0]]
        found = None if source is None else (source.role, step + source.offset)
        if step == self.last:  # beyond it there are no parts
            return Answer(member, step, "stop", found if source and source.offset == 0 else None)
        return Answer(member, step, "advance", found)

    def _is_ready(self, answer: Answer) -> bool:
        if answer.directive == "stop":
            return self.is_complete(answer.step)
        return answer.source is None or self._has_all(*answer.source)

    def _release(self) -> list[Answer]:
        answers = [self._answer(member, step) for member, step in self._waiting.items()]
        ready = [answer for answer in answers if self._is_ready(answer)]
        for answer in ready:
            self._answered[answer.member] = self._waiting.pop(answer.member)
        oldest = min(self._answered.values())  # a rank at this step may still repeat it
        for key in [key for key in self._parts if key[1] < oldest]:
            del self._parts[key]
        return ready
