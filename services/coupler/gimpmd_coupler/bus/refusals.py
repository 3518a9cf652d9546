"""Whom the router turned away, and why: read from Zenoh's own log.

Zenoh tells the reason of a refusal to nobody but its log, which it writes to standard output. We
give it a file without a name in place of standard output, and read that file several times a
second. A pipe would not do: the router would wait for its reader in a flood of refusals.

Zenoh does not log which host failed before it had shown a certificate, or on which key of the bus
a message was refused.
"""

from __future__ import annotations

import fcntl
import os
import re
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh

_LEVELS = ",".join(
    (
        "warn",
        "zenoh_link_tls=debug",  # certificates
        "zenoh_transport::unicast::establishment::accept=debug",  # passwords
        "zenoh::net::routing::interceptor=trace",  # rights; only refusals
        "zenoh::net::routing::interceptor::access_control=info",  # at "trace" each message counts
        "zenoh::net::primitives::demux=trace",  # adds to a line whose message it is about
    )
)
"""What Zenoh writes in its log of a bus with TLS.

The last one costs time for each message, so we ask for it only where somebody can be refused.
"""

_READ_SECONDS = 0.25
_READ_BYTES = 256 * 1024
"""Longest part of the log that is read at a time; what a flood adds to it is dropped."""

_MOST_PEERS = 1000

_MESSAGE = b"Msg intercepted"
"""Is in each line about a message that was refused."""

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(
    r"\S+Z +(?P<level>[A-Z]+) .*?(?P<place>zenoh\w*(?:::\w+)*): (?P<text>.*)$", re.DOTALL
)
_SENDER = re.compile(r"demux\{.*?client/(\w+)")
_CONNECTED = re.compile(r"Accepted TLS connection on \S+: (?P<host>\S+):\d+\. Common Name: (.*)\.$")
_LET_IN = re.compile(r"New transport link accepted from (\w+) .*?dst: tls/(\S+):\d+,")
_SOURCE = re.compile(r"\.? at /.*$|\.? Hint: increase the system open file limit\.?$")
"""What Zenoh adds to a reason: a line of its source, and a guess."""

_REASONS = (
    ("sent no certificates", "it has no certificate"),
    ("invalid peer certificate: Expired", "its certificate has expired"),
    ("invalid peer certificate", "its certificate is not one of this run"),
    ("received fatal alert", "it does not trust our certificate: it has keys of another run"),
    ("received corrupt message", "it does not speak TLS"),
    ("tls handshake eof", "it left before it showed a certificate"),
    ("Invalid password", "wrong password"),
    ("Invalid user", "wrong user"),
    ("Expected extension", "it has no password"),
)
"""Zenoh's reasons, and ours."""


class Reader:
    """Puts the lines of Zenoh's log into plain words."""

    def __init__(self) -> None:
        self._pending: list[str] = []  # have a certificate, and have shown no password yet
        self._peers: dict[str, str] = {}  # by `_short` of Zenoh's id

    def read(self, line: str) -> str:
        """Return what a line says about a refusal; empty if it says nothing.

        Warnings of Zenoh about other things are returned as they are.
        """
        line = _COLOUR.sub("", line).rstrip()
        found = _LINE.match(line)
        if found is None:
            return line
        place, text = found["place"], found["text"]
        if place == "zenoh::net::routing::interceptor":
            sender = _SENDER.search(line)
            who = self._peers.get(sender[1], "") if sender else ""
            return f"refused a message of {who or 'a rank'}: it is not allowed to send or read that"
        if place.endswith("access_control"):
            return f"refused {self._who()}: certificate and password belong to different sides"
        if connected := _CONNECTED.match(text):
            self._pending.append(f"{connected['host']} with the certificate of {connected[2]}")
            return ""
        if place.endswith("establishment::accept"):
            return self._after_password(text)
        if found["level"] not in ("WARN", "ERROR"):
            return ""
        reason = _plain(text)
        known = place.startswith("zenoh_link_tls")
        return f"refused a connection: {reason}" if known else f"Zenoh warns: {reason}"

    def _after_password(self, text: str) -> str:
        let_in = _LET_IN.match(text)
        if let_in is None:
            who = self._who()
            del self._pending[:1]
            return f"refused {who}: {_plain(text)}"
        peer, host = let_in.groups()
        who = next((one for one in self._pending if one.startswith(f"{host} ")), host)
        if who in self._pending:
            self._pending.remove(who)
        self._peers[_short(peer)] = who
        if len(self._peers) > _MOST_PEERS:
            del self._peers[next(iter(self._peers))]
        return ""

    def _who(self) -> str:
        """Name all to whom a refusal may apply: Zenoh does not say which of them it was."""
        return " or ".join(sorted(set(self._pending))) or "a connection"


def _short(peer: str) -> str:
    """Return the first four bytes of an id as Zenoh writes them: without zeros in front."""
    return peer.zfill(32)[:8].lstrip("0")


def _plain(text: str) -> str:
    text = _SOURCE.sub("", text)
    return next((ours for theirs, ours in _REASONS if theirs in text), text)


@contextmanager
def refusals(report: Callable[[str], None], tls: bool) -> Iterator[None]:
    """Report what Zenoh logs, in plain words. Once in a process, before a session is opened.

    Standard output goes on as ``sys.stdout``. The file descriptor 1 is Zenoh's from now on.

    Parameters
    ----------
    report : callable
        Called in a thread of its own. Refusals that repeat are reported at the first, tenth,
        hundredth ... time.
    tls : bool
        Whether the bus uses TLS. Otherwise nobody is refused, and only warnings are reported.
    """
    sys.stdout.flush()
    sys.stdout = os.fdopen(os.dup(1), "w", encoding="utf-8")
    with tempfile.TemporaryFile() as file:
        number = file.fileno()
        fcntl.fcntl(number, fcntl.F_SETFL, fcntl.fcntl(number, fcntl.F_GETFL) | os.O_APPEND)
        os.dup2(number, 1)
        zenoh.init_log_from_env_or(_LEVELS if tls else "warn")
        ended = threading.Event()
        thread = threading.Thread(target=_follow, args=(number, ended, report), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def _follow(file: int, ended: threading.Event, report: Callable[[str], None]) -> None:
    reader, counts = Reader(), Counter[str]()
    place, rest, last = 0, b"", False
    messages: list[bytes] = []
    while not last:
        last = ended.wait(_READ_SECONDS)
        new = os.pread(file, _READ_BYTES, place)
        place += len(new)
        *lines, rest = (rest + new).split(b"\n")
        # Another thread of Zenoh may log the first message of a rank before its link.
        former, messages = messages, [line for line in lines if _MESSAGE in line]
        lines = [line for line in lines if _MESSAGE not in line] + former
        for line in lines + (messages if last else []):
            text = reader.read(line.decode(errors="replace"))
            if text:
                counts[text] += 1
                if _is_power_of_ten(counts[text]):
                    report(text + (f" ({counts[text]} times)" if counts[text] > 1 else ""))
        if len(new) == _READ_BYTES or place > _READ_BYTES:
            os.ftruncate(file, 0)
            place, rest = 0, b""


def _is_power_of_ten(number: int) -> bool:
    return str(number).strip("0") == "1"
