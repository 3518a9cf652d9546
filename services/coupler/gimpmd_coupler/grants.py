"""How far ranks may go: grants ahead of time, and the end of the run. Pure logic, no network.

Ranks keep step with each other by the payloads that they wait for. The coupler only tells them up
to which step they may go. Grants reach seconds ahead, so that no rank ever waits for one.

To stop the run, the coupler takes the grants back: each rank stays where it stands and says so. The
run ends at the farthest of these steps, the same for all ranks.

How many steps pass in a second depends on the machine. A run that ends at a finding ends at the
same step on any machine: there grants reach a fixed number of steps ahead.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Grant, Member

AHEAD_SECONDS = 2.0
"""How far grants reach ahead of the slowest rank."""

FEWEST = 2
"""Steps that grants reach ahead at least: ranks need not wait for one at every step."""


def name(member: Member) -> str:
    """Name of a rank in messages and logs, such as ``md/0``."""
    return f"{member[0]}/{member[1]}"


@dataclass
class _Pace:
    """Steps per second, from two times at least `AHEAD_SECONDS` / 4 apart."""

    step: int
    time: float
    rate: float = 0.0

    def update(self, step: int, now: float) -> None:
        if now - self.time >= 0.25 * AHEAD_SECONDS:
            self.rate = (step - self.step) / (now - self.time)
            self.step, self.time = step, now


class Grants:
    """Collects which steps the ranks have completed, and decides how far they may go.

    Invariants: every rank reports its steps one after another. No rank has gone beyond ``granted``,
    which falls only at the end of a recall. All ranks end at ``last``.

    Parameters
    ----------
    members : all ranks of all roles.
    first, last : int
        First and last step.
    now : float
        Time (seconds), from any clock that runs evenly.
    reach : int, optional
        Steps that grants reach ahead of the slowest rank, at least `FEWEST`. If left out, as many
        as pass in `AHEAD_SECONDS`.
    together : int
        Coupling steps between two times at which all levels stand. The run ends at such a time.
    saves : bool
        Whether there is a checkpoint at the end of the run.

    Attributes
    ----------
    granted : int
        Step up to which ranks may advance.
    last : int
        Last step of the run.
    recalling : bool
        Whether ranks have been told to stay where they stand, and not all have answered.
    reported : dict
        Last step that each rank has completed.
    done : int
        Last step that all ranks have completed. Kept, because it is needed for every rank that
        waits at every report.
    """

    def __init__(
        self,
        members: Iterable[Member],
        first: int,
        last: int,
        now: float,
        reach: int | None = None,
        together: int = 1,
        saves: bool = False,
    ) -> None:
        self.last = last
        self._reach, self._together, self._saves = reach, together, saves
        self._checkpoint: int | None = None  # the last one that was ordered
        self.recalling = False
        self._holds: dict[Member, int] = {}  # steps at which ranks stay, while grants are recalled
        self.reported = dict.fromkeys(members, first - 1)
        self.done = first - 1
        self._pace = _Pace(first - 1, now)
        self.granted = min(first - 1 + (reach or FEWEST), last)

    def grant(self) -> Grant:
        """Return the present state as a message."""
        ends = self._saves and self.granted == self.last and not self.recalling
        checkpoints = (self._checkpoint, self.last if ends else None)
        return Grant(
            granted=self.granted,
            last=self.last,
            done=self.done,
            recall=self.recalling,
            checkpoints=tuple(step for step in checkpoints if step is not None),
        )

    def order_checkpoint(self, every: int) -> int | None:
        """Order a checkpoint at the next multiple of ``every`` that no rank has left behind.

        A rank leaves a step only with a grant beyond it, so it learns of the order in time.

        Returns
        -------
        int or None
            The step; None if the run ends before it. There is a checkpoint at the end anyway.
        """
        step = every * -(-self.granted // every)
        if step >= self.last or self.recalling:
            return None
        self._checkpoint = step
        return step

    def report(
        self,
        member: Member,
        steps: list[int],
        now: float,
        defect: int | None = None,
        holds: int | None = None,
    ) -> range:
        """Note that a rank has completed steps, and extend the grant.

        Parameters
        ----------
        steps : list of int
            Numbers of the steps; those reported before are allowed, because reports are repeated.
        defect : int, optional
            The first of these steps at which the rank has a finding that ends the run. Only
            where grants have a fixed reach r: the run then ends at step ``defect + r - 1``,
            whatever the order of the reports, because no rank has been allowed beyond it.
        holds : int, optional
            Step at which the rank stays, after a recall.

        Returns
        -------
        range
            The steps that are new.

        Raises
        ------
        ProtocolError
            A step is left out, or lies beyond what was granted, or is not where the rank can stay.
        """
        known = self.reported[member]
        later = [step for step in steps if step > known]
        new = range(known + 1, known + 1 + len(later))
        if later != list(new):
            raise ProtocolError(
                f"{name(member)} reports step {later[0]} after step {known}: steps must follow one"
                " another"
            )
        if new and new[-1] > self.granted:
            raise ProtocolError(
                f"{name(member)} reports step {new[-1]}, but may go to step {self.granted} only"
            )
        stands = new[-1] if new else known
        if holds is not None and not stands <= holds <= self.granted:
            raise ProtocolError(
                f"{name(member)} stays at step {holds}, but has completed step {stands} and may go"
                f" to step {self.granted}"
            )
        self.reported[member] = stands
        if new and known == self.done:
            self.done = min(self.reported.values())
        if new and defect is not None:
            self.end_after(defect)
        if not self.recalling:
            self._extend(now)
        elif holds is not None:
            self._hold(member, holds)
        return new

    def end_after(self, defect: int) -> None:
        """End the run because of a finding at a step, if grants have a fixed reach."""
        if self._reach is not None:
            self.last = min(self.last, defect + self._reach - 1)
            self.granted = min(self.granted, self.last)

    def may_go_on(self, member: Member) -> bool:
        """Whether a rank may advance, or can learn that the run ends or that it must stay.

        A rank that has completed step k stands at step k + 1 and waits there to advance to k + 2.
        """
        if self.recalling:
            return member not in self._holds
        return self.granted >= self.reported[member] + 2 or self.granted == self.last

    def stop(self) -> None:
        """Take the grants back; the run ends at the farthest step at which a rank then stands."""
        self.recalling, self._holds = not self.finished(), {}

    def settle(self) -> bool:
        """End a recall although some ranks do not answer; returns whether it has ended.

        A rank may not come to answer, because it waits for ranks of its own role that stay: in the
        same step, or further ahead by one step from rank to rank. So all go on to the farthest step
        at which a rank that waits can stand. Ranks that nobody of their role keeps waiting are
        merely slow.
        """
        silent = Counter(role for role, rank in self.reported.keys() - self._holds.keys())
        stay = Counter(role for role, rank in self._holds)
        if not self.recalling or any(role not in stay for role in silent):
            return False
        ahead = max((silent[role] + stay[role] - 1 for role in silent), default=0)
        self._end_at(max(self._holds.values()) + ahead)
        return True

    def _hold(self, member: Member, step: int) -> None:
        self._holds[member] = step
        if len(self._holds) == len(self.reported):
            self._end_at(max(self._holds.values()))

    def _end_at(self, step: int) -> None:
        """End the run at the next step, from a step on, at which all levels stand."""
        self.last = min(self.last, self._together * -(-step // self._together))
        self.granted = self.last
        self.recalling = False

    def finished(self) -> bool:
        """Whether all ranks have completed the last step."""
        return self.done == self.last

    def _extend(self, now: float) -> None:
        done = self.done
        self._pace.update(done, now)
        ahead = self._reach or max(FEWEST, math.ceil(AHEAD_SECONDS * self._pace.rate))
        self.granted = max(self.granted, min(done + ahead, self.last))
