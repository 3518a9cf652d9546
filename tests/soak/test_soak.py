"""A short soak; ``make soak`` is the long one."""

from __future__ import annotations

import random
from pathlib import Path

from tests.soak.__main__ import BROKEN, soak


def test_faults_lose_nothing(tmp_path: Path) -> None:
    outcomes = soak(["checkpoint altered"], 1, random.Random(2), tmp_path)
    (text,) = outcomes["checkpoint altered"]
    assert not text.startswith(BROKEN)
    assert text.startswith("resumed")
