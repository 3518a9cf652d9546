"""States of ranks: as they were saved, for as many ranks or others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_schemas.checkpoint.manifest import digest_of, folder_of, state_file
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from gimpmd_schemas.errors import BackendError

IDS = ([3, 1], [2, 7, 5])


def saved(run_dir: Path, rank: int, ranks: int) -> SavedStates:
    """Two ranks that hold some nodes, with the square of their ids as values."""
    for number, ids in enumerate(IDS):
        state = {
            "nodes/ids": np.array(ids),
            "nodes/square": np.stack([np.square(ids), np.zeros(len(ids))], axis=1),
            "total/work": np.array([0.5 + number, np.nan]),
        }
        digest = save_state(run_dir, 4, "md", number, state)
        assert digest == digest_of(folder_of(run_dir, 4) / state_file("md", number))
    paths = tuple(folder_of(run_dir, 4) / state_file("md", number) for number in range(2))
    return SavedStates(4, paths, rank, ranks)


def test_as_many_ranks_take_their_own(tmp_path: Path) -> None:
    second = saved(tmp_path, 1, 2)
    assert second.own["nodes/ids"].tolist() == IDS[1]
    assert second.total("work")[0] == 1.5
    assert [share["nodes/ids"].tolist() for share in second.shares()] == [IDS[1]]


@pytest.mark.parametrize("ranks", [1, 3])
def test_the_first_of_other_ranks_takes_all_amounts(tmp_path: Path, ranks: int) -> None:
    shares = [saved(tmp_path, rank, ranks) for rank in range(ranks)]
    assert shares[0].total("work")[0] == 2.0
    assert [len(share.shares()) for share in shares] == [2] + [0] * (ranks - 1)
    assert all(share.total("work")[0] == 0.0 for share in shares[1:])


def test_values_are_found_by_id_on_any_rank(tmp_path: Path) -> None:
    states = saved(tmp_path, 0, 1)
    values = states.by_id("nodes/square", "nodes/ids", np.array([7, 1, 5]))
    assert values.tolist() == [[49, 0], [1, 0], [25, 0]]
    assert states.by_id("nodes/square", "nodes/ids", np.empty(0, np.int64)).shape == (0, 2)
    with pytest.raises(BackendError, match="no nodes/square for 1 ids"):
        states.by_id("nodes/square", "nodes/ids", np.array([1, 4]))


def test_names(tmp_path: Path) -> None:
    assert saved(tmp_path, 0, 2).has("nodes/ids")
    assert not saved(tmp_path, 0, 1).has("nodes")


def test_a_run_folder_that_was_deleted_is_not_made_again(tmp_path: Path) -> None:
    """Half a folder would be no run, and would keep the user from starting anew."""
    run = tmp_path / "run"
    with pytest.raises(FileNotFoundError):
        save_state(run, 10, "md", 0, {"x": np.zeros(3)})
    assert not run.exists()
