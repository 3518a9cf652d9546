"""Connections that break and come back: every step once, with the right content."""

from __future__ import annotations

import contextlib
import random
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

pytestmark = pytest.mark.timeout(90)


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder with a name short enough for a socket in it."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def path_of(endpoint: str) -> str:
    """The socket of an endpoint."""
    return endpoint.removeprefix("unixsock-stream/")


class Proxy:
    """A relay in front of a socket that now and then cuts or holds up all connections."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        self.cuts = 0
        self._target = path_of(endpoint)
        self._open: list[socket.socket] = []
        self._done, self._flows = threading.Event(), threading.Event()
        self._flows.set()
        self._server = socket.socket(socket.AF_UNIX)
        self._server.bind(str(folder / "relay"))
        self._server.listen()
        self.endpoint = f"unixsock-stream/{folder}/relay"
        self._acceptor = threading.Thread(target=self._accept, daemon=True)
        self._acceptor.start()

    def _accept(self) -> None:
        self._server.settimeout(0.1)
        while not self._done.is_set():
            try:
                near, _ = self._server.accept()
            except TimeoutError:
                continue
            far = socket.socket(socket.AF_UNIX)
            try:
                far.connect(self._target)
            except (ConnectionRefusedError, FileNotFoundError):  # the coupler has ended
                near.close()
                continue
            self._open += [near, far]
            for pair in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=pair, daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self._flows.wait()
                sink.sendall(data)
        except OSError:
            pass  # cut
        source.close()
        sink.close()

    def cut(self) -> None:
        """Break all connections."""
        connections, self._open = self._open, []
        self.cuts += bool(connections)
        for end in connections:
            with contextlib.suppress(OSError):  # its other end was first
                end.shutdown(socket.SHUT_RDWR)

    def hold(self, seconds: float) -> None:
        """Let nothing pass for a while; connections stay open."""
        self._flows.clear()
        time.sleep(seconds)
        self._flows.set()

    def close(self) -> None:
        self._done.set()
        self._acceptor.join()
        self.cut()
        self._server.close()


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
