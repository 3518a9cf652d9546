"""Names of dumps with strain."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_deploy.launch.strain import default_output


@pytest.mark.parametrize(
    ("dump", "out"),
    [
        ("a/atoms.dump", "a/atoms.strain.dump"),
        ("run.lammpstrj.gz", "run.strain.lammpstrj"),
        ("dump", "dump.strain"),
    ],
)
def test_default_output(dump: str, out: str) -> None:
    assert default_output(Path(dump)) == Path(out)
