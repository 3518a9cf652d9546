"""The benchmark of the overhead measures what it says, in a run of one block."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import overhead


@pytest.mark.parametrize("size", ["small", "metal"])
def test_apart_each_process_has_one_core(size: str) -> None:
    for apart, ranks in ((False, 2), (True, 1)):
        md = overhead.case_of(size, apart)["md"]
        assert md["ranks"] == np.prod(md["patches"]) == ranks
        assert len(md["patches"]) == len(md["region"])
    assert overhead.case_of(size, apart=True)["continuum"]["threads"] == 1


@pytest.mark.long
def test_blocks_are_timed_coupled_and_bare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overhead, "BLOCKS", {"small": 3})
    times = overhead.time_blocks("small", tmp_path / "case")
    assert times.shape == (3, 5)
    assert (times > 0.0).all()
    assert (times[:, 2] < times[:, 0]).all()
    assert (times[:, 3] == times[:, 4]).all()


@pytest.mark.long
def test_pure_md_has_atoms_in_the_whole_body(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overhead, "BLOCKS", {"metal": 1})
    times = overhead.time_blocks("metal", tmp_path / "case", whole=True)
    assert times[0, 4] == 4 * 36**3
