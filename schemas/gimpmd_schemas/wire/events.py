"""Events that the coupler prints to standard output: one JSON object per line."""

from __future__ import annotations

import msgspec


class Listening(msgspec.Struct, frozen=True, tag=True):
    """The bus is open; services connect to ``endpoint``."""

    endpoint: str


class Alive(msgspec.Struct, frozen=True, tag=True):
    """The coupler lives; said twice a second if the process that started it supervises it."""


class Registered(msgspec.Struct, frozen=True, tag=True):
    """A rank has registered."""

    who: str


class Progress(msgspec.Struct, frozen=True, tag=True):
    """The run has reached a coupling step."""

    step: int
    last_step: int
    time: float


class Checkpointed(msgspec.Struct, frozen=True, tag=True):
    """A checkpoint counts from now on: the run can go on from its step."""

    step: int
    time: float


class Found(msgspec.Struct, frozen=True, tag=True):
    """A monitor found that results are not reliable; said once for each kind and side.

    Attributes
    ----------
    message : what, on which side, when, where, and what to do, as text for the user.
    """

    step: int
    message: str


class Waiting(msgspec.Struct, frozen=True, tag=True):
    """No part has arrived for some time; ``who`` names the ranks that the coupler waits for."""

    who: tuple[str, ...]
    seconds: float


class Lost(msgspec.Struct, frozen=True, tag=True):
    """A process died or stopped responding; ``who`` is the culprit, not its victims."""

    who: str
    step: int
    reason: str


class ServiceFailed(msgspec.Struct, frozen=True, tag=True):
    """A service reported an error that ended it."""

    who: str
    message: str
    exit_code: int


class Ended(msgspec.Struct, frozen=True, tag=True):
    """The run has ended and ``run.h5`` is closed.

    Attributes
    ----------
    step, time : how far it came.
    stopped : whether it ended before its end time.
    defect : text for the user, if a finding ended it (``coupling.on_defect: stop``).
    """

    step: int
    time: float
    stopped: bool
    defect: str = ""


Event = (
    Listening
    | Alive
    | Registered
    | Progress
    | Checkpointed
    | Found
    | Waiting
    | Lost
    | ServiceFailed
    | Ended
)
