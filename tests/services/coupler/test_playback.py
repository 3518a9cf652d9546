"""A rank that is played back: what it sends, and how it compares what it gets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_coupler.participant import OFFSET, OTHER
from gimpmd_coupler.playback import Playback
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.messages import Refused, encode
from gimpmd_schemas.wire.recording import Recording, open_recording
from gimpmd_schemas.wire.replay import Difference, Replay
from tests.recordings import NEEDS, OFFERS, energies, fields, payload, write

LAST = 3


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    write(tmp_path / "x", LAST)
    with open_recording(tmp_path / "x") as opened:
        yield opened


def incoming(role: str, rank: int, step: int) -> dict[str, np.ndarray[Any, Any]]:
    """What a rank got at a step of the recorded run."""
    source = step + OFFSET[role]
    if source > LAST:
        return {}
    senders = [member for member in OFFERS if member[0] == OTHER[role]]
    nodes = np.concatenate([OFFERS[member] for member in senders])
    order = [int(np.flatnonzero(nodes == node)[0]) for node in NEEDS[role, rank]]
    parts = [fields(member, source) for member in senders]
    return {name: np.concatenate([p[name] for p in parts])[order] for name in parts[0]}


def played(recording: Recording, role: str, rank: int = 0, **settings: Any) -> Playback:
    stops: list[int] = []
    settings = {"recording": "x", "side": role} | settings
    side = Playback(recording, rank, Replay(**settings), lambda: stops.append(1))
    side.stops = stops
    return side


def run(side: Playback, role: str, rank: int, changes: Mapping[int, float] = {}) -> None:
    """Let the loop call a side; velocities at the steps of ``changes`` are a little larger."""
    for step in range(LAST + 1):
        sent = side.zone_fields()
        for name, array in fields((role, rank), step).items():
            np.testing.assert_array_equal(sent[name], array)
        side.finish()
        got = incoming(role, rank, step)
        if step in changes:
            got["velocity"][1, 0] += changes[step]
        side.receive(got)
        side.advance()
        assert side.energies() == (energies(step) if step % 2 == 0 else None)
        assert side.findings() == ()


@pytest.mark.parametrize(("role", "rank", "count"), [("md", 1, 3), ("continuum", 0, 8)])
def test_it_sends_what_was_sent_and_finds_the_same_bits(
    recording: Recording, role: str, rank: int, count: int
) -> None:
    side = played(recording, role, rank)
    np.testing.assert_array_equal(side.offers, OFFERS[role, rank])
    np.testing.assert_array_equal(side.needs, NEEDS[role, rank])
    assert side.notes == ("a note",)
    run(side, role, rank)
    assert side.compared().payloads == count  # of the continuum: two ranks at four steps
    assert (side.compared().first, side.compared().largest, side.stops) == (None, {}, [])


@pytest.mark.parametrize(
    ("role", "rank", "sender"), [("md", 1, "continuum/0"), ("continuum", 0, "md/0")]
)
def test_the_first_difference_is_named_and_ends_the_run(
    recording: Recording, role: str, rank: int, sender: str
) -> None:
    side = played(recording, role, rank)
    run(side, role, rank, {1: 2.0**-20, 2: 2.0**-10})
    first = Difference(
        step=1 + OFFSET[role], rank=sender, field="velocity", largest=2.0**-20, nodes=1
    )
    found = side.compared()
    assert found.first == first
    assert found.differing == 2
    assert found.largest["velocity"].largest == 2.0**-10
    assert side.stops


def test_a_replay_may_go_on(recording: Recording) -> None:
    side = played(recording, "continuum", goes_on=True)
    run(side, "continuum", 0, {1: 2.0**-10})
    assert side.compared().differing == 1
    assert side.stops == []


def test_differences_within_the_tolerance_are_accepted(recording: Recording) -> None:
    side = played(recording, "continuum", tolerance={"velocity": 2.0**-15, "mass": 0.0})
    run(side, "continuum", 0, {0: 2.0**-20, 2: -(2.0**-16)})
    found = side.compared()
    assert (found.differing, found.first, side.stops) == (0, None, [])
    assert (found.largest["velocity"].step, found.largest["velocity"].largest) == (2, 2.0**-16)


def test_the_sign_of_zero_counts(recording: Recording) -> None:
    side = played(recording, "md", 1)
    side.zone_fields()
    got = incoming("md", 1, 0)
    # the recorded run has no zeros, so the payload is put in place of one that has
    side._next.payloads["continuum", 0]["velocity"] = np.zeros((2, 2))
    side.receive({"velocity": np.zeros_like(got["velocity"])})
    assert side.compared().first is None
    side.receive({"velocity": -np.zeros_like(got["velocity"])})
    assert side.compared().first == Difference(
        step=1, rank="continuum/0", field="velocity", largest=0.0, nodes=2
    )


def test_a_recording_that_is_too_short_ends_the_replay(recording: Recording) -> None:
    side = played(recording, "continuum")
    run(side, "continuum", 0)
    with pytest.raises(GimpmdError, match="ends before the replay"):
        side.zone_fields()


def test_beyond_a_failure_the_last_fields_are_sent_once_more(tmp_path: Path) -> None:
    tail = (payload(("continuum", 0), LAST + 1), encode(Refused(reason="continuum/0 was lost")))
    write(tmp_path / "x", LAST, *tail)
    with open_recording(tmp_path / "x") as recording:
        side = played(recording, "md", 1)
        for _ in range(LAST + 1):
            side.zone_fields()
        beyond = side.zone_fields()
    for name, array in fields(("md", 1), LAST).items():
        np.testing.assert_array_equal(beyond[name], array)
