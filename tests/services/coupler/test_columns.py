"""Arrays that grow as ranks report."""

from __future__ import annotations

import numpy as np

from gimpmd_coupler.columns import Columns


def test_rows_come_out_as_they_were_put_in() -> None:
    """Ranks far ahead of each other, many steps, and pieces of other lengths than those put in."""
    ranks, steps = 3, 1000
    columns, reported, taken = Columns(first=5), [5, 5, 5], []
    chance = np.random.default_rng(1)
    while min(reported) < 5 + steps:
        rank = int(chance.integers(ranks))
        some = range(reported[rank], reported[rank] + int(chance.integers(1, 90)))
        columns.put("a", ranks, rank, some, 10.0 * np.array(some) + rank)
        columns.put("b", ranks, rank, some, 7)
        reported[rank] = some.stop
        ready = min(reported) - 5 - sum(len(page["a"]) for page in taken)
        taken.append(columns.take(int(chance.integers(ready + 1))) if ready else {"a": []})
    rows = np.concatenate([page["a"] for page in taken if len(page["a"])])
    expected = 10.0 * np.arange(5, 5 + len(rows))[:, None] + np.arange(ranks)
    assert len(rows) > steps // 2
    np.testing.assert_array_equal(rows, expected)
    assert all(np.all(page["b"] == 7) for page in taken if "b" in page)


def test_what_was_taken_out_stays() -> None:
    columns = Columns(first=0)
    columns.put("a", 1, 0, range(3), [1.0, 2.0, 3.0])
    page = columns.take(2)
    columns.put("a", 1, 0, range(3, 300), np.full(297, 9.0))
    assert page["a"].tolist() == [[1.0], [2.0]]
    assert columns.take(2)["a"].tolist() == [[3.0], [9.0]]


def test_what_nobody_has_put_in_is_zero() -> None:
    columns = Columns(first=0)
    columns.put("a", 2, 1, range(1), [1.0])
    columns.put("b", 1, 0, range(2), [5, 6])
    page = columns.take(2)
    assert page["a"].tolist() == [[0.0, 1.0], [0.0, 0.0]]
    assert page["b"].tolist() == [[5], [6]]
