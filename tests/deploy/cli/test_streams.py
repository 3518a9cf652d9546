"""Standard output that goes away while a command runs."""

import os
import pty
import subprocess
import sys

PROGRAM = """
import sys, time
from rich.console import Console
from gimpmd_deploy.cli.streams import outlive_readers
outlive_readers()
console = Console()
console.print("first")
sys.stdin.readline()
for _ in range(3):
    console.print("more")
    print("more", file=sys.stderr, flush=True)
open(sys.argv[1], "w").write("reached the end")
"""


def reaches_the_end(tmp_path, out: int, reader: int) -> bool:
    """Whether a program goes on when the reader of its output is closed after a line."""
    end = tmp_path / "end"
    words = [sys.executable, "-c", PROGRAM, str(end)]
    child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=out, stderr=out)
    os.close(out)
    assert os.read(reader, 100).startswith(b"first")
    os.close(reader)
    child.communicate(b"\n", timeout=60)
    return child.returncode == 0 and end.read_text() == "reached the end"


def test_a_closed_pipe_is_no_error(tmp_path):
    reader, out = os.pipe()
    assert reaches_the_end(tmp_path, out, reader)


def test_a_closed_terminal_is_no_error(tmp_path):
    reader, out = pty.openpty()
    assert reaches_the_end(tmp_path, out, reader)


def test_other_errors_stay_errors(tmp_path):
    program = PROGRAM.replace(
        "outlive_readers()\nconsole", "outlive_readers()\nsys.stdout.flush()\nconsole"
    )
    words = [sys.executable, "-c", program, str(tmp_path / "end")]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, input=b"\n", stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode != 0
    assert b"No space left on device" in done.stderr
