"""What one rank of the service that is checked has sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gimpmd_coupler.bus.stage import Heard
from gimpmd_coupler.check.log import UnmetError, expect
from gimpmd_coupler.mapping import Link
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import Array, Message, Payload, Register, Report, decode


def _no_nodes() -> Ints:
    return np.empty(0, dtype=np.int64)


@dataclass(eq=False)
class Rank:
    """One rank, as the coupler and the other side see it.

    Attributes
    ----------
    role, number : its role, and its number.
    registrations : requests to register, in order.
    needs, offers : ids of the nodes of the registration.
    links : nodes that it takes from each rank of the other side.
    frames : payloads by step, as often as they came.
    reports : all reports, also those that came twice.
    reported : the last step that it has reported.
    energies : what it has reported, by step.
    holds : the step at which it stays after a recall; None before it has said so.
    waits_for : whom it waits for, as it said last.
    saved : digests of the saved states by step.
    pending : number of the report that has not been answered; empty if there is none.
    """

    role: Role
    number: int
    registrations: list[Heard] = field(default_factory=list)
    needs: Ints = field(default_factory=_no_nodes)
    offers: Ints = field(default_factory=_no_nodes)
    links: dict[int, Link] = field(default_factory=dict)
    frames: dict[int, list[bytes]] = field(default_factory=dict)
    reports: list[Heard] = field(default_factory=list)
    reported: int = -1
    energies: dict[int, Energies] = field(default_factory=dict)
    holds: int | None = None
    waits_for: set[str] = field(default_factory=set)
    saved: dict[int, str] = field(default_factory=dict)
    pending: bytes = b""

    @property
    def name(self) -> str:
        """Its name on the bus."""
        return f"{self.role}/{self.number}"

    def registration(self, nodes: int) -> Register:
        """Its registration; also takes the nodes from it.

        Parameters
        ----------
        nodes : int
            Number of nodes of the grid.

        Raises
        ------
        UnmetError
            It cannot be read, or its nodes are none.
        """
        message, arrays = decoded(self.registrations[0].data, Register)
        self.offers, self.needs = _ids("offers", arrays, nodes), _ids("needs", arrays, nodes)
        found: Register = message
        return found

    def take_payload(self, heard: Heard, first: int) -> None:
        """Note a payload; the run began at step ``first``.

        Raises
        ------
        UnmetError
            It is one of another rank, or of a step that is not the next.
        """
        message, _ = decoded(heard.data, Payload)
        expect(
            (message.role, message.rank) == (self.role, self.number),
            f"payloads of {self.name} on its key",
            f"one of {message.role}/{message.rank}",
        )
        known = max(self.frames, default=first - 1)
        expect(
            message.step <= known + 1,
            f"the payload of step {known + 1}",
            f"that of step {message.step}",
        )
        self.frames.setdefault(message.step, []).append(heard.data)

    def take_report(self, heard: Heard) -> None:
        """Note a report.

        Raises
        ------
        UnmetError
            It cannot be read, or leaves steps out.
        """
        self.reports.append(heard)
        message, _ = decoded(heard.data, Report)
        steps = [one.step for one in message.steps]
        if not (steps and steps[-1] <= self.reported):  # it is not one that was sent again
            whole = list(range(self.reported + 1, self.reported + 1 + len(steps)))
            expect(steps == whole, f"a report of the steps {whole}", f"one of {steps}")
        for one in message.steps:
            self.reported = max(self.reported, one.step)
            if one.energies is not None:
                self.energies[one.step] = one.energies
        self.waits_for = set(message.waits_for)
        self.holds = message.holds if message.holds is not None else self.holds
        self.saved.update({one.step: one.digest for one in message.saved})
        self.pending = heard.number


def decoded(frame: bytes, kind: type[Any]) -> tuple[Any, dict[str, Array]]:
    """The message and the arrays of a frame.

    Raises
    ------
    UnmetError
        It is no frame with such a message.
    """
    try:
        found: tuple[Message, dict[str, Array]] = decode(frame, kind)
    except ProtocolError as error:
        raise UnmetError(f"a frame with a message {kind.__name__}", str(error)) from None
    return found


def _ids(name: str, arrays: Mapping[str, Array], nodes: int) -> Ints:
    """Ids of nodes in a registration."""
    ids = arrays.get(name, np.empty(0))
    expect(
        name in arrays and ids.dtype == np.int64 and ids.ndim == 1,
        f"an array {name!r} of int64 with one axis",
        f"{ids.dtype} of shape {ids.shape}" if name in arrays else "no such array",
    )
    inside = bool(((ids >= 0) & (ids < nodes)).all())
    expect(inside, f"{name} with ids below {nodes}, the number of nodes", "others too")
    return ids
