"""Settings and results of a replay."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.replay import (
    REPLAY,
    Compared,
    Difference,
    Replay,
    load_result,
    load_settings,
    merged,
    write_result,
    write_settings,
)


def difference(step: int, rank: int, largest: float) -> Difference:
    return Difference(step=step, rank=f"md/{rank}", field="force", largest=largest, nodes=1)


SAME = Compared(payloads=3, differing=0, first=None, largest={})
EARLY, LATE = difference(2, 1, 1e-9), difference(5, 0, 1e-3)


def test_settings_survive_their_file(tmp_path: Path) -> None:
    settings = Replay(recording="/x/y", side="md", tolerance={"velocity": 1e-9}, goes_on=True)
    write_settings(tmp_path, settings)
    assert load_settings(tmp_path) == settings


def test_settings_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_settings(tmp_path)
    (tmp_path / REPLAY).mkdir()
    (tmp_path / REPLAY / "settings.json").write_text("{}")
    with pytest.raises(InputError, match="recording"):
        load_settings(tmp_path)


def test_the_first_and_the_largest_difference_of_all_ranks_count(tmp_path: Path) -> None:
    one = Compared(payloads=3, differing=1, first=LATE, largest={"force": LATE})
    other = Compared(payloads=4, differing=2, first=EARLY, largest={"force": EARLY})
    whole = Compared(payloads=10, differing=3, first=EARLY, largest={"force": LATE})
    assert merged([one, SAME, other]) == whole
    write_settings(tmp_path, Replay(recording="", side="continuum"))
    for rank, part in enumerate((one, SAME, other)):
        write_result(tmp_path, rank, part)
    assert load_result(tmp_path) == whole


def test_without_results_nothing_was_compared(tmp_path: Path) -> None:
    assert load_result(tmp_path) == Compared(payloads=0, differing=0, first=None, largest={})
