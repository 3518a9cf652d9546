"""Connections that break and come back: every step once, with the right content."""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.relay import Proxy

pytestmark = pytest.mark.timeout(90)


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder with a name short enough for a socket in it."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def test_cut_connections_lose_and_double_nothing(
    start: Callable[..., Any], short_folder: Path
) -> None:
    run = start(time__end=48)
    random_, proxy = random.Random(7), Proxy(run.endpoint, short_folder)
    run.endpoint = proxy.endpoint
    children = run.join_all("--pause", "0.003")  # they check the content of every step
    run.coupler.wait_for(type="Progress", step=0)
    while run.coupler.process.poll() is None:
        time.sleep(random_.uniform(0.1, 0.5))
        proxy.cut()
    proxy.close()
    assert run.coupler.end() == 0, run.coupler.lines
    assert {child.end() for child in children.values()} == {0}
    assert proxy.cuts >= 3
    with h5py.File(run.folder / "run.h5") as file:
        np.testing.assert_array_equal(file["series/step"], np.arange(601))


@pytest.mark.parametrize(("seconds", "who"), [(1.0, "md/1"), (3.0, "all")])
def test_a_network_that_fails_for_seconds_changes_nothing(
    start: Callable[..., Any], short_folder: Path, seconds: float, who: str
) -> None:
    """After 2 s without a sign of life both ends give up a connection and open another."""
    run = start(time__end=24)
    direct = run.endpoint
    proxy = Proxy(direct, short_folder)
    children = []
    for role, rank in (("md", 0), ("md", 1), ("continuum", 0)):
        run.endpoint = proxy.endpoint if who in ("all", f"{role}/{rank}") else direct
        children.append(run.join(role, rank, "--pause", "0.003"))
    run.coupler.wait_for(type="Progress", step=0)
    time.sleep(0.5)
    proxy.hold(seconds)
    assert run.coupler.end() == 0, run.coupler.lines
    proxy.close()
    assert {child.end() for child in children} == {0}
    with h5py.File(run.folder / "run.h5") as file:
        np.testing.assert_array_equal(file["series/step"], np.arange(301))
