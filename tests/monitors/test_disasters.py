"""Disasters that the monitors must find, and a few sound runs.

``python -m tests.monitors`` has more. A run takes a second or two; kernels that have to be compiled
first take longer.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.monitors.disasters import DISASTERS
from tests.monitors.running import run, told
from tests.monitors.sound import sound

QUICK = ("deleted", "stronger after")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.long) for n in DISASTERS]
)
def test_the_monitors_find_a_disaster(name: str, tmp_path: Path) -> None:
    disaster = DISASTERS[name]()
    made = run(disaster.story, tmp_path)
    kinds = [(one.side, one.finding.kind) for one in made]
    assert (disaster.side, disaster.kind) in kinds, list(told(made))


@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 11))]
)
def test_the_monitors_are_silent_in_a_sound_run(seed: int, tmp_path: Path) -> None:
    assert list(told(run(sound(seed), tmp_path))) == []
