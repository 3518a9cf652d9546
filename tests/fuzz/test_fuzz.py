"""A short run of the fuzzer; ``make fuzz`` feeds ten million inputs."""

import re
import subprocess
import sys

from tests.conftest import ROOT

INPUTS = 20_000


def test_decoders_refuse_what_they_cannot_read():
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--inputs", str(INPUTS)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(re.search(r"Done (\d+) runs", done.stderr)[1]) >= INPUTS
