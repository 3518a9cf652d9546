"""A short soak; ``make soak`` is the long one."""

from __future__ import annotations

import random
from pathlib import Path

from tests.soak.__main__ import BROKEN, soak


def test_faults_lose_nothing(tmp_path: Path) -> None:
    names = ("kill -9 the coupler", "checkpoint altered")
    outcomes = soak(names, len(names), random.Random(3), tmp_path)
    texts = [text for counts in outcomes.values() for text in counts]
    assert not [text for text in texts if text.startswith(BROKEN)]
    assert len(texts) == len(names)
