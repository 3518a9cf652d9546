"""Processes that tests start find this package, and two workers share the tests.

Each worker runs one group of tests after another. Tests that look at the same finished runs form
one group, so that these runs are made once; the other tests of a file form a group of their own.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = str(Path(__file__).parents[1])
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [ROOT, os.environ.get("PYTHONPATH")]))

SHARED_RUNS = ("runs", "finished")
"""Fixtures that hold finished runs for the whole session."""


@pytest.hookimpl(tryfirst=True)  # before the workers read the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        shared = [name for name in SHARED_RUNS if name in fixtures]
        item.add_marker(pytest.mark.xdist_group(shared[0] if shared else str(item.path)))
