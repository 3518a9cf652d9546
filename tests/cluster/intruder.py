"""Somebody who wants to disturb a run: ``intruder.py MANNER ENDPOINT RUN KEYS``.

It says ``at work`` when it has begun, and goes on until it is killed. It says ``refused`` and
ends if it is not let in.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from gimpmd_coupler.bus.keys import rank_settings
from gimpmd_coupler.bus.settings import config

FRAMES, HUGE = 100_000, 300 * 2**20
ENTITIES: list[Any] = []  # as long as they are kept, they are declared
TLS, WORD = "transport/link/tls", "transport/auth/usrpwd/password"


def forge(session: zenoh.Session, start: str) -> None:
    """Speak as the other side and as the coupler, and spy on both."""
    keys = ("**", f"{start}/answer/continuum/0")
    held = [session.declare_subscriber(key, lambda sample: None) for key in keys]
    token = session.liveliness().declare_token(f"{start}/alive/continuum/0")
    kinds = ("register", "report", "failed", "data", "answer")
    while held and token:
        for key in (*(f"{kind}/continuum/0" for kind in kinds), "again/md/0"):
            session.put(f"{start}/{key}", b"forged" * 50, attachment=bytes(16))
        time.sleep(0.001)


def flood(session: zenoh.Session, start: str) -> None:
    """Send frames that no other rank or coupler may get."""
    for _ in range(FRAMES):
        session.put(f"{start}/data/continuum/0", b"x" * 100)


def flood_own(session: zenoh.Session, start: str) -> None:
    """The same on keys that are allowed, those of the rank whose keys it has."""
    for _ in range(FRAMES // 2):
        session.put(f"{start}/data/md/0", b"x" * 100)
        session.put(f"{start}/report/md/0", b"x" * 100, attachment=b"x" * 16)


def never_read(session: zenoh.Session, start: str) -> None:
    """Ask for all that this side may have, and take nothing."""

    def hang(sample: zenoh.Sample) -> None:
        time.sleep(1000.0)

    silent = zenoh.handlers.Callback(hang, indirect=False)
    for key in ("data/continuum/*", "answer/md/*", "again/md/*"):
        ENTITIES.append(session.declare_subscriber(f"{start}/{key}", silent))


def replay(session: zenoh.Session, start: str) -> None:
    """Send payloads that this side may have again, old ones after new ones."""
    remote = zenoh.Locality.REMOTE  # not what it sends itself
    frames = session.declare_subscriber(f"{start}/data/continuum/*", allowed_origin=remote)
    old: list[bytes] = []
    for sample in frames.handler:
        old = [*old[-20:], sample.payload.to_bytes()]
        for frame in old[::-5]:
            for key in ("data/continuum/0", "data/md/0", "data/md/1"):
                session.put(f"{start}/{key}", frame)


def take_tokens(session: zenoh.Session, start: str) -> None:
    """Come and go in the name of ranks of both sides."""
    while True:
        for rank in ("md/0", "md/1", "continuum/0", "md/7"):
            token = session.liveliness().declare_token(f"{start}/alive/{rank}")
            time.sleep(0.01)
            token.undeclare()


def huge(session: zenoh.Session, start: str) -> None:
    """Send one frame of 300 MB in the name of the other side."""
    session.put(f"{start}/data/continuum/0", bytes(HUGE))


DENIED = "refused a message of 10.77.0.2 with the certificate of md/0"

MANNERS: dict[str, tuple[Callable[..., None], str, str]] = {
    "forge": (forge, "mine", DENIED),
    "flood": (flood, "mine", DENIED),
    "flood of own keys": (flood_own, "mine", "refused report of md/0"),
    "huge": (huge, "mine", ""),
    "never read": (never_read, "mine", ""),
    "replay": (replay, "mine", DENIED),
    "take tokens": (take_tokens, "mine", DENIED),
    "no certificate": (forge, "none", "refused a connection: it has no certificate"),
    "certificate of another run": (forge, "another", "it has keys of another run"),
    "no TLS": (forge, "plain", "refused a connection: it does not speak TLS"),
}
"""What intruders do, the keys that they have, and what the log of the coupler says about it."""


def settings(kind: str, keys: Path) -> dict[str, Any]:
    """How the intruder tries to enter, with keys of rank 0 of the MD, or of another run."""
    mine = rank_settings(keys, "md", 0)
    if kind == "none":
        return {TLS: {"root_ca_certificate": mine[TLS]["root_ca_certificate"]}}
    return {} if kind == "plain" else mine


def main() -> None:
    manner, endpoint, run, keys = sys.argv[1:]
    act, kind, _ = MANNERS[manner]
    place = endpoint.replace("tls/", "tcp/") if kind == "plain" else endpoint
    try:
        session = zenoh.open(config("client", place, settings(kind, Path(keys)), 2.0))
    except zenoh.ZError:
        print("refused", flush=True)
        return
    with session:
        print("at work", flush=True)
        act(session, f"gimpmd/{run}")
        time.sleep(1000.0)


if __name__ == "__main__":
    main()
