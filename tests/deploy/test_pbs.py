"""The template of a PBS job; `tests/cluster` runs it on two hosts, without PBS."""

import subprocess

from tests.conftest import ROOT

TEMPLATE = ROOT / "deploy" / "job.pbs"


def test_bash_can_read_it():
    done = subprocess.run(["bash", "-n", TEMPLATE], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_options_of_pbs_come_before_the_first_command():
    """PBS reads no further."""
    lines = TEMPLATE.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line and not line.startswith("#"))
    options = [i for i, line in enumerate(lines) if line.startswith("#PBS ")]
    assert len(options) == 3
    assert max(options) < first
