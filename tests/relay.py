"""A relay in front of the socket of the coupler, which breaks connections."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from pathlib import Path


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
