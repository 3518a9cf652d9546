"""Strips run two at a time, in folders that go when the process ends."""

from __future__ import annotations

import tempfile
from collections.abc import Hashable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from tests.physics.strips import Run, run_case

Key = TypeVar("Key", bound=Hashable)

AT_A_TIME = 2
"""A coupled strip keeps about one core busy: its sides take turns."""

_FOLDER = tempfile.TemporaryDirectory(prefix="gimpmd-interface-")


def new_folder() -> Path:
    """Empty, and gone when the process ends."""
    return Path(tempfile.mkdtemp(dir=_FOLDER.name))


def run_all(cases: Iterable[tuple[Key, dict[str, Any], tuple[str, ...]]]) -> dict[Key, Run]:
    """Run cases, each with its own options of the command; by key."""

    def run(case: dict[str, Any], options: tuple[str, ...]) -> Run:
        return run_case(case, new_folder(), *options)

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        futures = {key: pool.submit(run, case, options) for key, case, options in cases}
        return {key: future.result() for key, future in futures.items()}


def run_one(case: dict[str, Any], *options: str) -> Run:
    """Run one case."""
    return run_all([("it", case, options)])["it"]
