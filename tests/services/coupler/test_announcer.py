"""Events for a reader that does not read."""

from __future__ import annotations

import subprocess
import sys
import time

import msgspec

from gimpmd_schemas.wire.events import Alive, Event, Lost, Progress, Registered

EMIT = """
import time
from gimpmd_coupler.announcer import emit
from gimpmd_schemas.wire.events import Lost, Progress, Registered
start = time.monotonic()
for rank in range(256):
    emit(Registered(f"md/{rank}"))
for step in range(20_000):
    emit(Progress(step, 20_000, 0.1 * step))
emit(Lost("md/3", 20_000, "its process is gone"))
assert time.monotonic() - start < 20.0
"""
BEAT = """
import time
from gimpmd_coupler.announcer import start_beating
start_beating()
time.sleep(2.2)
"""


def events_of(program: str, wait: bool) -> list[Event]:
    """What a process emits; with ``wait``, it is read only when the process has ended."""
    words = [sys.executable, "-c", program]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as child:
        if wait:
            assert child.wait(timeout=60) == 0, "it waits for its reader"
        lines = child.stdout.read().splitlines()
    return [msgspec.json.decode(line, type=Event) for line in lines]


def test_nothing_waits_for_a_reader_and_a_failure_is_kept() -> None:
    events = events_of(EMIT, wait=True)
    assert [type(event) for event in events[:256]] == [Registered] * 256
    assert events[-1] == Lost("md/3", 20_000, "its process is gone")
    assert len(events) < 1000


def test_a_reader_that_reads_gets_progress_to_the_end() -> None:
    events = events_of(EMIT.replace("20_000):", "2_000):\n    time.sleep(1e-4)"), wait=False)
    assert Progress(1999, 20_000, 199.9) in events


def test_signs_of_life_come_twice_a_second() -> None:
    assert 4 <= events_of(BEAT, wait=True).count(Alive()) <= 5


def test_a_reader_that_is_gone_is_no_error() -> None:
    words = [sys.executable, "-c", EMIT]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    child.stdout.close()
    start = time.monotonic()
    assert child.wait(timeout=60) == 0, child.stderr.read()
    child.stderr.close()
    assert time.monotonic() - start < 60
