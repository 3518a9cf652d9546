"""The recording of a run as it is written: order, repeats, a run that goes on, a full disk."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_coupler import frame_writer
from gimpmd_coupler.frame_writer import LOST_SECONDS, FrameWriter
from gimpmd_schemas.errors import InputError, StorageError
from gimpmd_schemas.wire.messages import Refused, StepReport, encode
from gimpmd_schemas.wire.recording import Member, open_recording
from tests.recordings import OFFERS, energies, payload, register, write

REGISTERS = {member: register(member) for member in OFFERS}
SENDERS = frozenset(OFFERS)


def send(writer: FrameWriter, step: int, *members: Member) -> None:
    """Let ranks send the payload of a step; all if none is named."""
    for role, rank in members or OFFERS:
        writer.take(role, str(rank), payload((role, rank), step))


def reports(step: int) -> dict[Member, StepReport]:
    """Reports of all ranks, with energies at even steps."""
    found = energies(step) if step % 2 == 0 else None
    return dict.fromkeys(OFFERS, StepReport(step=step, energies=found, timings={"wait": 0.5}))


def record(writer: FrameWriter, first: int, last: int) -> None:
    """Record some steps as a run does."""
    writer.begin(REGISTERS, SENDERS)
    for step in range(first, last + 1):
        send(writer, step)
        assert writer.is_whole(step, 0.0)
        writer.add(step, reports(step))


@pytest.fixture
def expected(tmp_path: Path) -> Callable[..., bytes]:
    """Return the bytes of a recording up to a step."""

    def make(last: int, *more: bytes) -> bytes:
        write(tmp_path / "expected", last, *more)
        return (tmp_path / "expected").read_bytes()

    return make


def test_steps_follow_one_another(tmp_path: Path, expected: Callable[..., bytes]) -> None:
    writer = FrameWriter(tmp_path / "x")
    record(writer, 0, 5)
    writer.close()
    assert (tmp_path / "x").read_bytes() == expected(5)


def test_repeated_and_forged_payloads_change_nothing(
    tmp_path: Path, expected: Callable[..., bytes]
) -> None:
    writer = FrameWriter(tmp_path / "x")
    record(writer, 0, 0)
    send(writer, 0)  # once more
    writer.take("md", "1", payload(("md", 0), 1))  # in the name of another
    writer.take("md", "1", b"no frame")
    assert not writer.is_whole(1, 0.0)
    send(writer, 1, ("md", 1), ("md", 0))
    send(writer, 1)
    writer.add(1, reports(1))
    writer.close()
    assert (tmp_path / "x").read_bytes() == expected(1)


def test_a_run_that_goes_on_has_each_step_once(
    tmp_path: Path, expected: Callable[..., bytes]
) -> None:
    write(tmp_path / "x", 7)
    writer = FrameWriter(tmp_path / "x", first=4)
    record(writer, 4, 9)
    writer.close()
    assert (tmp_path / "x").read_bytes() == expected(9)


def test_a_recording_that_ends_before_the_checkpoint_cannot_go_on(tmp_path: Path) -> None:
    write(tmp_path / "x", 7)
    (tmp_path / "x").write_bytes((tmp_path / "x").read_bytes()[:-100])
    with pytest.raises(InputError, match="ends with step 6, but the run goes on from step 8"):
        FrameWriter(tmp_path / "x", first=8)
    with pytest.raises(InputError, match="cannot be read"):
        FrameWriter(tmp_path / "y", first=8)


def test_a_run_that_fails_leaves_what_had_been_sent(
    tmp_path: Path, expected: Callable[..., bytes]
) -> None:
    writer, refusal = FrameWriter(tmp_path / "x"), encode(Refused(reason="md/0 was lost"))
    record(writer, 0, 3)
    send(writer, 4)
    send(writer, 5, ("continuum", 0))
    send(writer, 7, ("continuum", 0))  # a gap: left out
    writer.note_failure(refusal)
    writer.close()
    tail = [payload(member, 4) for member in sorted(OFFERS)]
    rest = expected(3, *tail, payload(("continuum", 0), 5), refusal)
    found = (tmp_path / "x").read_bytes()
    assert len(found) == len(rest)
    with open_recording(tmp_path / "x") as recording:
        steps = list(recording.steps())
    assert recording.failure == "md/0 was lost"
    assert [len(one.payloads) for one in steps] == [3, 3, 3, 3, 3, 1]


def test_a_payload_that_is_lost_ends_the_recording(
    tmp_path: Path, expected: Callable[..., bytes]
) -> None:
    writer = FrameWriter(tmp_path / "x")
    record(writer, 0, 2)
    send(writer, 3, ("md", 0), ("continuum", 0))
    assert not writer.is_whole(3, 10.0)
    assert not writer.is_whole(3, 10.0 + 0.9 * LOST_SECONDS)
    assert writer.is_whole(3, 10.0 + 1.1 * LOST_SECONDS)
    for step in (3, 4):
        send(writer, step)
        writer.add(step, reports(step))
    writer.close()
    assert (tmp_path / "x").read_bytes() == expected(2)


def test_much_is_written_at_once_and_the_rest_every_few_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = FrameWriter(tmp_path / "x")
    record(writer, 0, 0)
    start = (tmp_path / "x").stat().st_size
    record(writer, 1, 1)
    assert (tmp_path / "x").stat().st_size == start
    monkeypatch.setattr(frame_writer, "FLUSH_BYTES", 1000)
    record(writer, 2, 2)
    assert (tmp_path / "x").stat().st_size > start
    writer.close()


def test_without_space_the_steps_before_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, expected: Callable[..., bytes]
) -> None:
    writer = FrameWriter(tmp_path / "x")
    record(writer, 0, 2)
    writer.flush()
    record(writer, 3, 4)

    def full(*_: object) -> int:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(StorageError, match="No space left"):
        writer.flush()
    writer.close()  # does not try again
    assert (tmp_path / "x").read_bytes() == expected(2)
