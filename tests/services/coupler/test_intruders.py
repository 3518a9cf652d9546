"""Intruders that are already on the bus: they get in, but the run does not notice.

On a Unix socket, processes of the same user may do anything. Between hosts, rights on the keys of
the bus come on top of this (the last test, and `test_keys`).
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from gimpmd_coupler.bus.connection import Payload, connect
from gimpmd_coupler.bus.keys import rank_settings
from gimpmd_coupler.bus.settings import AT_ONCE, config
from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.wire.messages import Failed, encode
from tests.ports import free_port

pytestmark = pytest.mark.timeout(120)

Intrude = Callable[..., subprocess.Popen[str]]

NEVER_READS = """
sub = session.declare_subscriber(
    "gimpmd/test/**", zenoh.handlers.Callback(lambda sample: time.sleep(1000), indirect=False))
"""

REPLAYS = """
import threading
from collections import deque
from queue import SimpleQueue

seen, mine = SimpleQueue(), set()

def note(sample):  # nothing may be published here
    seen.put((str(sample.key_expr), sample.payload.to_bytes()))

def key_of_other(key):
    *start, kind, role, rank = key.split("/")
    other = "continuum/0" if role == "md" else "md/0"
    return "/".join([*start, kind, other])

def replay():
    old, count = deque(maxlen=40), 0
    while True:
        key, frame = seen.get()
        if frame in mine:  # it is one of ours
            continue
        old.append((key, frame))
        mine.update((frame, frame[:-3]))
        count += 1
        for key, frame in list(old)[::-7]:  # some old ones, the last first
            session.put(key, frame, **AT_ONCE)
            session.put(key_of_other(key), frame, **AT_ONCE)
            session.put(key, frame[:-3], **AT_ONCE)
        if count == 50:
            print("replayed", flush=True)

threading.Thread(target=replay, daemon=True).start()
direct = zenoh.handlers.Callback(note, indirect=False)
sub = session.declare_subscriber("gimpmd/test/data/**", direct)
"""

TAKES_TOKENS = """
import threading

def flicker():
    while True:
        for rank in ("md/0", "md/1", "continuum/0", "md/7", "nobody/x"):
            token = session.liveliness().declare_token(f"gimpmd/test/alive/{rank}")
            time.sleep(0.01)
            token.undeclare()

threading.Thread(target=flicker, daemon=True).start()
"""

FLOODS = """
import threading

def flood():
    for count in range(20_000):
        session.put("gimpmd/test/data/md/0", b"x" * 100, **AT_ONCE)
        if count % 100 == 0:
            session.put("gimpmd/test/register/md/1", b"x" * 100, **AT_ONCE)
            session.put("gimpmd/test/again/md/1", bytes(8), **AT_ONCE)
    print("flooded", flush=True)

threading.Thread(target=flood, daemon=True).start()
"""

START = """
import os, sys, time
import zenoh
from gimpmd_coupler.bus.settings import AT_ONCE, config, tune_process

tune_process("client")
session = zenoh.open(config("client", sys.argv[1], None, 10.0))
{act}
print("at work", flush=True)
time.sleep(1000)
"""


@pytest.fixture
def intrude(tmp_path: Path) -> Iterator[Intrude]:
    """Let an intruder begin."""
    begun: list[subprocess.Popen[str]] = []

    def begin(endpoint: str, act: str) -> subprocess.Popen[str]:
        words = [sys.executable, "-c", START.format(act=act), endpoint]
        child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        begun.append(child)
        assert child.stdout is not None
        assert child.stdout.readline().strip() == "at work"
        return child

    yield begin
    for child in begun:
        child.kill()
        child.wait()
        assert child.stdout is not None
        child.stdout.close()


@pytest.mark.parametrize(("size", "count"), [(1000, 8000), (600_000, 15), (10**6, 30)])
def test_a_subscriber_that_never_reads_stops_nobody(
    start: Callable[..., Any], intrude: Intrude, size: int, count: int
) -> None:
    """Once it held up all ranks when its queue was full: for 10 s with frames of 600 KB."""
    endpoint = start().endpoint
    with (
        connect(endpoint, "test", "md", 0) as sender,
        connect(endpoint, "test", "continuum", 0) as taker,
    ):
        taker.subscribe(["md/0"])
        intrude(endpoint, NEVER_READS)
        longest = 0.0
        for step in range(count):
            begun = time.monotonic()
            sender.publish(step, step.to_bytes(8, "little") + bytes(size))
            item = taker.receive(10.0)
            assert isinstance(item, Payload), step
            assert int.from_bytes(item.data[:8], "little") == step
            sender.forget(step)
            longest = max(longest, time.monotonic() - begun)
    assert longest < 5.0


@pytest.mark.parametrize(
    ("act", "done"),
    [
        (REPLAYS, "replayed"),
        (TAKES_TOKENS, ""),
        (FLOODS, "flooded"),
        (NEVER_READS, ""),
    ],
    ids=["replays", "tokens", "floods", "never reads"],
)
def test_every_rank_still_gets_its_own_fields(
    start: Callable[..., Any], intrude: Intrude, act: str, done: str
) -> None:
    """The ranks compare every value that comes with the one that was sent."""
    run = start(time__end=16)
    intruder = intrude(run.endpoint, act)
    children = run.join_all("--pause", "0.005")
    if done:
        children["continuum0"].wait_for(accepted=...)
        assert intruder.stdout is not None
        assert intruder.stdout.readline().strip() == done
    assert run.coupler.end() == 0
    for child in children.values():
        assert child.end() == 0
        assert child.wait_for(ended=run.plan.steps)
    ended = run.coupler.wait_for(type="Ended")
    assert (ended["step"], ended["stopped"]) == (run.plan.steps, False)


@pytest.mark.parametrize("victim", ["md/1", "md/0"])
def test_who_has_the_keys_of_one_rank_can_end_the_run_as_this_rank_only(
    start: Callable[..., Any], tmp_path: Path, victim: str
) -> None:
    """It sends what would end the run, and payloads, with the keys of md/0."""
    keys, rank = tmp_path / "keys", int(victim[-1])
    new_keys(keys, ["127.0.0.1"], {"md": 2, "continuum": 1})
    place = f"tls/127.0.0.1:{free_port()}"
    run = start("--listen", place, "--keys", str(keys), time__end=16)
    children = run.join_all("--keys", str(keys), "--pause", "0.03")
    children["continuum0"].wait_for(accepted=...)
    last_word = encode(Failed(role="md", rank=rank, message="forged", exit_code=3))
    with zenoh.open(config("client", place, rank_settings(keys, "md", 0), 5.0)) as session:
        for _ in range(10):
            session.put(f"gimpmd/test/data/{victim}", b"forged", **AT_ONCE)
        session.put(f"gimpmd/test/failed/{victim}", last_word, attachment=b"x" * 16, **AT_ONCE)
        code = run.coupler.end()
    log = (run.folder / "logs" / "coupler.log").read_text()
    refused = "refused a message of 127.0.0.1 with the certificate of md/0: it is not allowed"
    if victim == "md/0":
        assert (code, refused in log) == (3, False)
        assert run.coupler.find(type="ServiceFailed", who="md/0")
        return
    assert (code, refused in log) == (0, True)
    for child in children.values():
        assert child.end() == 0
        assert child.wait_for(ended=run.plan.steps)
