"""Processes that tests start find this package too; tests run in an order that saves time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

FIRST = ("physics/gimp", "services/coupler", "system", "test_docs.py", "physics")
"""Parts of the tests, in the order in which they run; all others follow.

One worker compiles most kernels in the first part, while another runs the second, which needs none:
two would compile the same. Then come the files with whole runs, so that all workers end at about
the same time.
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _part(item.path.relative_to(ROOT / "tests").as_posix()))


def _part(path: str) -> int:
    return next((n for n, part in enumerate(FIRST) if path.startswith(part)), len(FIRST))
