"""The lockstep clock: which answer waits for which parts. Pure logic, no network.

A rank hands in its part of step k and is answered once the parts it depends on are in. What an
answer depends on is a table, and the table is the coupling scheme.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar, get_args

from gimpmd_schemas.case.form import SchemeName
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Role

Part = TypeVar("Part")
Member = tuple[Role, int]
"""A rank of a role."""


@dataclass(frozen=True)
class Source:
    """The answer to step k holds the parts of ``role`` for step ``k + offset``; offset >= 0."""

    role: Role
    offset: int


Schedule = Mapping[Role, Source | None]

SCHEDULES: dict[tuple[str, str], Schedule] = {
    (scheme, order): {"md": Source("continuum", offset), "continuum": Source("md", 0)}
    for scheme in get_args(SchemeName)
    for order, offset in (("serial", 1), ("parallel", 0))
}
"""What each role's answer depends on, by coupling scheme and order."""


def name(member: Member) -> str:
    """Name of a rank as messages and logs give it, such as ``md/0``."""
    return f"{member[0]}/{member[1]}"


@dataclass(frozen=True)
class Answer:
    """An answer that can be given: to whom, and the parts ``(role, step)`` that it holds."""

    member: Member
    step: int
    directive: Literal["advance", "stop"]
    source: tuple[Role, int] | None


class Rendezvous(Generic[Part]):
    """Collects parts and says which requests can be answered.

    Invariants: every rank goes through the steps one by one; each step is answered in one way,
    however often it is asked (parts are kept until nobody can ask for them again); all ranks of
    all roles end with the same step.

    Parameters
    ----------
    ranks : mapping of role to its number of ranks
    schedule : what the answers to each role depend on; ``None`` for a role that is alone
    first, last : int
        Steps; at the last one everybody is told to stop.
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
        """Hand in a part.

        Parameters
        ----------
        member : Member
        step : int
        part : what the rank brings; a repeated request changes nothing.

        Returns
        -------
        list of Answer
            All requests, of whatever rank, that can now be answered.

        Raises
        ------
        ProtocolError
            The step is neither the rank's next nor a repetition of its last.
        """
        self.check(member, step)
        if self._repeats(member, step):
            return [self._answer(member, step)]
        self._parts.setdefault((member[0], step), {}).setdefault(member[1], part)
        self._waiting[member] = step
        return self._release()

    def check(self, member: Member, step: int) -> None:
        """Raise ProtocolError if the step is neither the rank's next nor a repetition."""
        expected = self._waiting.get(member, self._answered[member] + 1)
        if not self._repeats(member, step) and (step != expected or step > self.last):
            told = "has been told to stop" if expected > self.last else f"is at step {expected}"
            raise ProtocolError(f"{name(member)} sends step {step} but {told}")

    def stop(self) -> list[Answer]:
        """End the run at the first step that nobody has been told to pass.

        Returns
        -------
        list of Answer
            Requests that this settles.
        """
        self.last = min(self.last, max(self._answered.values()) + 1)
        return self._release()

    def is_complete(self, step: int) -> bool:
        """Whether all ranks of all roles have handed in their parts of a step."""
        return all(self._has_all(role, step) for role in self._ranks)

    def parts(self, role: Role, step: int) -> list[Part]:
        """Return the parts of a role for a step that is complete, in the order of its ranks."""
        parts = self._parts[role, step]
        return [parts[rank] for rank in range(self._ranks[role])]

    def finished(self) -> bool:
        """Whether everybody has been told to stop."""
        return all(step == self.last for step in self._answered.values())

    def awaited(self) -> list[Member]:
        """Ranks that are at work; all others wait for them or have been told to stop."""
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
        oldest = min(self._answered.values())  # whoever stands there may still repeat that step
        for key in [key for key in self._parts if key[1] < oldest]:
            del self._parts[key]
        return ready
