"""What the coupler tells whoever started it: one JSON object a line on standard output."""

from __future__ import annotations

import msgspec


class Listening(msgspec.Struct, frozen=True, tag=True):
    """The bus is open; services connect to ``endpoint``."""

    endpoint: str


class Registered(msgspec.Struct, frozen=True, tag=True):
    """A rank has joined."""

    who: str


class Progress(msgspec.Struct, frozen=True, tag=True):
    """The run stands at a coupling step."""

    step: int
    last_step: int
    time: float


class Waiting(msgspec.Struct, frozen=True, tag=True):
    """No part has arrived for a while; names whom the coupler waits for."""

    who: tuple[str, ...]
    seconds: float


class Lost(msgspec.Struct, frozen=True, tag=True):
    """A process died or fell silent; ``who`` is the culprit, not its victims."""

    who: str
    step: int
    reason: str


class ServiceFailed(msgspec.Struct, frozen=True, tag=True):
    """A service could not go on and said why."""

    who: str
    message: str
    exit_code: int


class Ended(msgspec.Struct, frozen=True, tag=True):
    """The run is over and ``run.h5`` is closed; ``stopped`` if before its end time."""

    step: int
    time: float
    stopped: bool


Event = Listening | Registered | Progress | Waiting | Lost | ServiceFailed | Ended
