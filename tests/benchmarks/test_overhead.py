"""The benchmark of the overhead measures what it says, in a run of one block."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks import overhead


@pytest.mark.long
def test_blocks_are_timed_coupled_and_bare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overhead, "BLOCKS", {"small": 3})
    times = overhead.time_blocks("small", tmp_path / "case")
    assert times.shape == (3, 2)
    assert (times > 0.0).all()
