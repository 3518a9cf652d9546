"""Pipes to a stand-in of the coupler."""

import sys

from gimpmd_deploy.launch.coupler_pipe import CouplerPipe
from gimpmd_deploy.launch.processes import Service, start
from gimpmd_schemas.wire.events import Listening

PROGRAM = """
import sys
print('{"type": "Listening", "endpoint": "tcp/x"}', flush=True)
print("some words", flush=True)
sys.exit(0 if sys.stdin.readline() == "stop\\n" else 1)
"""


def test_events_come_in_and_stop_goes_out(tmp_path):
    log = tmp_path / "coupler.log"
    child = start(Service("coupler", [sys.executable, "-c", PROGRAM], log, tmp_path), talks=True)
    pipe = CouplerPipe(child)
    events = []
    while not (events and log.read_text()):
        events += pipe.events(0.1)
    pipe.stop()
    while pipe.is_open():
        events += pipe.events(0.1)
    assert events == [Listening("tcp/x")]
    assert log.read_text() == "some words\n"
    assert child.process.wait(timeout=10) == 0
    pipe.close()
