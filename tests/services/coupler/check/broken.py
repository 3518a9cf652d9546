"""The continuum service with a fault: ``python broken.py FAULT``, then the arguments of a service.

Each fault is a few lines that change what the service does in one respect.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace

from gimpmd_coupler import participant
from gimpmd_coupler.bus.connection import Connection
from gimpmd_coupler.participant import Participant
from gimpmd_gimp import service
from gimpmd_gimp.coupling.force import ForceScheme
from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.wire import messages
from gimpmd_schemas.wire.messages import Refused, decode


def changed(owner: Any, name: str, change: Callable[..., Any]) -> None:
    """Replace a function by one that gets the old one as its first argument."""
    old = getattr(owner, name)
    setattr(owner, name, lambda *args, **kwargs: change(old, *args, **kwargs))


def nothing(*_: Any, **__: Any) -> None:
    """What a service does that leaves something out."""


def wrong_version() -> None:
    participant.PROTOCOL_VERSION -= 1


def wrong_plan() -> None:
    participant.Plan.digest = lambda self: "0" * 64


def too_few_nodes() -> None:
    changed(
        Participant,
        "register",
        lambda old, self, offers, *more: old(self, offers[1:], *more),
    )


def never_registers() -> None:
    Connection._send_request = nothing


def no_reports() -> None:
    changed(
        Connection,
        "request",
        lambda old, self, kind, frame: None if kind == "report" else old(self, kind, frame),
    )


def wrong_step() -> None:
    changed(messages, "Payload", lambda old, step, **more: old(step=step + 1, **more))


def spoilt_fields(spoil: Callable[[np.ndarray], np.ndarray]) -> None:
    Participant._check_own = nothing
    changed(
        ContinuumSide,
        "zone_fields",
        lambda old, self: {name: spoil(array) for name, array in old(self).items()},
    )


def wrong_shape() -> None:
    spoilt_fields(lambda array: array[:-1])


def not_finite() -> None:
    spoilt_fields(lambda array: array * np.nan)


def beyond_its_grant() -> None:
    Participant._ready = lambda self: not self._missing()


def ignores_stop() -> None:
    def take(old: Any, self: Any, data: bytes) -> None:
        message, _ = decode(data, (messages.Grant, Refused))
        if not getattr(message, "recall", False):
            old(self, data)

    changed(Participant, "_take_answer", take)


def ignores_failures() -> None:
    def take(old: Any, self: Any, data: bytes) -> None:
        message, _ = decode(data, (messages.Grant, Refused))
        if not isinstance(message, Refused):
            old(self, data)

    changed(Participant, "_take_answer", take)


def loses_momentum() -> None:
    def halved(old: Any, self: Any) -> Any:
        found = old(self)
        return found and replace(found, momentum=tuple(0.5 * p for p in found.momentum))

    changed(ContinuumSide, "energies", halved)


def hides_work() -> None:
    def without(old: Any, self: Any) -> Any:
        found = old(self)
        return found and replace(found, interface_work=0.0)

    changed(ContinuumSide, "energies", without)


def ignores_requests_for_payloads() -> None:
    Connection._take_again = nothing


def asks_for_no_payload() -> None:
    Connection.ask_again = nothing


def counts_doubled_payloads() -> None:
    def take(old: Any, self: Any, payload: Any) -> None:
        old_ones = dict(self._payloads)
        old(self, payload)
        try:
            message, arrays = decode(payload.data, messages.Payload)
        except participant.ProtocolError:
            return
        known = old_ones.get((payload.peer, message.step))
        if known is not None:
            twice = {name: array + arrays[name] for name, array in known.items()}
            self._payloads[payload.peer, message.step] = twice

    changed(Participant, "_take_payload", take)


def believes_anybody() -> None:
    def take(old: Any, self: Any, payload: Any) -> None:
        try:
            message, arrays = decode(payload.data, messages.Payload)
        except participant.ProtocolError:
            return
        self._payloads.setdefault((payload.peer, message.step), arrays)

    changed(Participant, "_take_payload", take)


def believes_any_field() -> None:
    participant._misfit = lambda *_: ""


def survives_the_coupler() -> None:
    Connection._watch = Connection._wait_for_coupler = nothing


def wrong_digest() -> None:
    changed(Participant, "note_saved", lambda old, self, digest: old(self, digest[::-1]))


def starts_anew() -> None:
    service.saved_states = nothing


def cracks_at_the_interface() -> None:
    """The forces of the atoms do not reach the nodes of the interface."""
    changed(
        ForceScheme,
        "receive",
        lambda old, self, fields: old(self, {"force": 0.5 * fields["force"]}),
    )


def ignores_its_second_rank() -> None:
    """The forces on the nodes of the second rank are not used."""
    changed(ForceScheme, "receive", lambda old, self, fields: old(
        self, {"force": (self._solver.comm.rank == 0) * fields["force"]}))  # fmt: skip


def names_its_first_rank_twice() -> None:
    """All ranks send the energies of the first one."""
    changed(ContinuumSide, "energies", lambda old, self: self._solver.comm.bcast(old(self)))


def takes_rows_in_its_own_order() -> None:
    """Fields of a peer are taken as if they came in the order of its own nodes."""
    changed(participant, "Link", lambda old, rows, places: old(np.sort(rows), places))


def mixes_up_y_and_z() -> None:
    changed(ForceScheme, "receive", lambda old, self, fields: old(
        self, {"force": fields["force"][:, [0, 2, 1]]}))  # fmt: skip


def counts_nodes_along_y_first() -> None:
    """Ids of nodes as if y were the last axis, and not z."""

    def swapped(ids: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        x, y, z = np.unravel_index(ids, shape)
        return np.ravel_multi_index((x, z, y), (shape[0], shape[2], shape[1])).astype(np.int64)

    def register(old: Any, self: Any, offers: Any, needs: Any, *more: Any) -> Any:
        shape = self._plan.background_grid().shape
        return old(self, swapped(offers, shape), swapped(needs, shape), *more)

    changed(Participant, "register", register)


def forgets_the_coarse_level() -> None:
    """Only points of the finest level are counted."""

    def counted(old: Any, self: Any) -> Any:
        found, solver = old(self), self._solver.solver
        fine = solver.points.mass[solver.points.level == solver.top].sum()
        return found and replace(found, mass=float(fine))

    changed(ContinuumSide, "energies", counted)


def holds_the_coarse_level() -> None:
    """Points of the coarse level do not move."""

    def start(old: Any, self: Any) -> None:
        points = self.solver.points
        points.v[points.level < self.solver.top] = 0.0
        old(self)

    changed(Gimp, "start_step", start)


RANKS, PEERS = ["--ranks", "2"], ["--peers", "2"]
SPACE, LEVELS = ["--body", "space"], ["--body", "levels"]
OPTIONS = {
    "ignores_its_second_rank": RANKS,
    "names_its_first_rank_twice": RANKS,
    "takes_rows_in_its_own_order": PEERS,
    "mixes_up_y_and_z": SPACE,
    "counts_nodes_along_y_first": SPACE,
    "forgets_the_coarse_level": LEVELS,
    "holds_the_coarse_level": LEVELS,
}
"""Options of the check for faults that show with several ranks, in space or on levels only."""

FAULTS = {
    fault.__name__: fault
    for fault in (
        wrong_version,
        wrong_plan,
        too_few_nodes,
        never_registers,
        no_reports,
        wrong_step,
        wrong_shape,
        not_finite,
        beyond_its_grant,
        ignores_stop,
        ignores_failures,
        loses_momentum,
        hides_work,
        ignores_requests_for_payloads,
        asks_for_no_payload,
        counts_doubled_payloads,
        believes_anybody,
        believes_any_field,
        survives_the_coupler,
        wrong_digest,
        starts_anew,
        cracks_at_the_interface,
        ignores_its_second_rank,
        names_its_first_rank_twice,
        takes_rows_in_its_own_order,
        mixes_up_y_and_z,
        counts_nodes_along_y_first,
        forgets_the_coarse_level,
        holds_the_coarse_level,
    )
}

if __name__ == "__main__":
    FAULTS[sys.argv.pop(1)]()
    sys.exit(service.main())
