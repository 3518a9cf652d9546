"""Broken bonds over the time of a run."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from gimpmd_deploy.results.defects import RunDefects


def write(path: Path, counts: list[int], place: list[float]) -> None:
    with h5py.File(path, "w") as file:
        file["series/time"] = 0.5 * np.arange(len(counts))
        file["series/md/broken_bonds"] = counts
        for k, axis in enumerate("xyz"):
            file[f"series/md/broken_at_{axis}"] = np.array(place) + k


def read(path: Path) -> RunDefects | None:
    with h5py.File(path) as file:
        return RunDefects.read(file["series"])


def test_the_first_broken_bond(tmp_path: Path) -> None:
    write(tmp_path / "run.h5", [0, 0, 3, 7], [np.nan, np.nan, 10.0, 20.0])
    defects = read(tmp_path / "run.h5")
    assert defects is not None
    first = defects.first()
    assert first is not None
    time, place = first
    assert time == 1.0
    assert place == pytest.approx((10.0, 11.0, 12.0))


def test_a_run_without_broken_bonds(tmp_path: Path) -> None:
    write(tmp_path / "run.h5", [0, 0], [np.nan, np.nan])
    defects = read(tmp_path / "run.h5")
    assert defects is not None
    assert defects.first() is None


def test_a_run_of_one_side_watches_none(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["series/time"] = [0.0]
        file["series/md/kinetic"] = [0.0]
    assert read(tmp_path / "run.h5") is None
