"""Events of the coupler as lines of JSON."""

from __future__ import annotations

import json
from typing import get_args

import msgspec
import pytest

from gimpmd_schemas.wire import events
from gimpmd_schemas.wire.events import (
    Checkpointed,
    Ended,
    Event,
    Found,
    Listening,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)

EXAMPLES = {
    Listening("tcp/127.0.0.1:7447"): {"endpoint": "tcp/127.0.0.1:7447"},
    events.Alive(): {},
    Registered("md/0"): {"who": "md/0"},
    Progress(3, 10, 0.24): {"step": 3, "last_step": 10, "time": 0.24},
    Checkpointed(50, 4.0): {"step": 50, "time": 4.0},
    Waiting(("md/0", "md/1"), 12.5): {"who": ["md/0", "md/1"], "seconds": 12.5},
    Lost("md/1", 7, "killed by signal 9"): {
        "who": "md/1",
        "step": 7,
        "reason": "killed by signal 9",
    },
    ServiceFailed("continuum/0", "line\nbreak", 2): {
        "who": "continuum/0",
        "message": "line\nbreak",
        "exit_code": 2,
    },
    Found(20, "near (1, 2)"): {"step": 20, "message": "near (1, 2)"},
    Ended(10, 0.8, False): {"step": 10, "time": 0.8, "stopped": False, "defect": ""},
}


def test_every_event_has_an_example() -> None:
    assert {type(event) for event in EXAMPLES} == set(get_args(Event))
    structs = {one for one in vars(events).values() if isinstance(one, msgspec.StructMeta)}
    assert structs == set(get_args(Event))


@pytest.mark.parametrize(("event", "fields"), EXAMPLES.items(), ids=lambda one: type(one).__name__)
def test_an_event_is_one_line_with_its_name(event, fields) -> None:
    line = msgspec.json.encode(event)
    assert b"\n" not in line
    assert json.loads(line) == {"type": type(event).__name__} | fields
    assert msgspec.json.decode(line, type=Event) == event


@pytest.mark.parametrize(
    "line",
    [
        b"some words",
        b'{"who": "md/0"}',
        b'{"type": "Vanished", "who": "md/0"}',
        b'{"type": "Registered"}',
        b'{"type": "Progress", "step": "three", "last_step": 10, "time": 0.0}',
    ],
)
def test_other_lines_are_no_events(line: bytes) -> None:
    """The supervisor writes them to the log."""
    with pytest.raises(msgspec.DecodeError):
        msgspec.json.decode(line, type=Event)
