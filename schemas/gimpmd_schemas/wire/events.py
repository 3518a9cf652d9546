"""Events that the coupler prints to standard output: one JSON object per line."""

from __future__ import annotations

import msgspec


class Listening(msgspec.Struct, frozen=True, tag=True):
    """The bus is open; services connect to ``endpoint``."""

    endpoint: str


class Registered(msgspec.Struct, frozen=True, tag=True):
    """A rank has registered."""

    who: str


class Progress(msgspec.Struct, frozen=True, tag=True):
    """The run has reached a coupling step."""

    step: int
    last_step: int
    time: float


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
    """The run has ended and ``run.h5`` is closed; ``stopped``: before its end time."""

    step: int
    time: float
    stopped: bool


Event = Listening | Registered | Progress | Waiting | Lost | ServiceFailed | Ended
