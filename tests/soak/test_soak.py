"""A short soak; ``make soak`` is the long one."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.soak.__main__ import BROKEN, soak
from tests.soak.faults import FAULTS, names_cause


@pytest.mark.long
def test_faults_lose_nothing(tmp_path: Path) -> None:
    outcomes = soak(["checkpoint altered"], 1, random.Random(2), tmp_path)
    (text,) = outcomes["checkpoint altered"]
    assert not text.startswith(BROKEN)
    assert text.startswith("resumed")


@pytest.mark.parametrize(
    ("name", "said", "named"),
    [
        ("kill -9 mpiexec", "md/1 was lost at step 3", True),
        ("kill -9 mpiexec", "md/1 has joined; continuum/0 was lost at step 3", False),
        ("memory limit of the continuum", "error: continuum/0: no memory", True),
        ("disk full", "cannot write: No space left on\ndevice", True),
        ("disk full", "continuum/0 was lost at step 3", False),
        ("kill -9 the launcher", "", True),
    ],
)
def test_the_cause_is_asked_for(name: str, said: str, named: bool) -> None:
    assert name in FAULTS
    assert names_cause(name, said) is named
