"""What is known about the processes of ranks."""

from __future__ import annotations

import socket
import subprocess
import sys

import msgspec

from gimpmd_coupler.processes import Processes
from tests.services.coupler.test_roster import register


def test_a_process_that_ends_is_gone() -> None:
    processes, member = Processes(), ("md", 0)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        here = {"host": socket.gethostname(), "pid": child.pid}
        processes.look_up(member, msgspec.structs.replace(register(), **here))
        assert processes.is_running(member)
        assert processes.state(member).startswith(f"its process {child.pid} is ")
        child.kill()  # not waited for yet: a zombie
        child.communicate()
    assert not processes.is_running(member)
    assert processes.state(member) == f"its process {child.pid} is gone"


def test_nothing_is_known_about_a_process_on_another_host() -> None:
    processes, member = Processes(), ("md", 0)
    processes.look_up(member, msgspec.structs.replace(register(), host="elsewhere"))
    assert processes.is_running(member)
    assert processes.state(member) == "it is remote"
