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
TLS, WORD = "transport/link/tls", "transport/auth/usrpwd/password"


def forge(session: zenoh.Session, start: str) -> None:
    """Speak as the other side and as the coupler, and spy on both."""
    held = [session.declare_subscriber(key, print) for key in ("**", f"{start}/answer/continuum/0")]
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


def huge(session: zenoh.Session, start: str) -> None:
    """Send one frame of 300 MB in the name of the other side."""
    session.put(f"{start}/data/continuum/0", bytes(HUGE))


MANNERS: dict[str, tuple[Callable[..., None], str]] = {
    "forge": (forge, "mine"),
    "flood": (flood, "mine"),
    "huge": (huge, "mine"),
    "no certificate": (forge, "none"),
    "certificate of another run": (forge, "another"),
    "no TLS": (forge, "plain"),
}


def settings(kind: str, keys: Path) -> dict[str, Any]:
    """How the intruder tries to enter; ``keys`` are those of the MD side, or of another run."""
    mine = rank_settings(keys, "md")
    if kind == "none":
        return {TLS: {"root_ca_certificate": mine[TLS]["root_ca_certificate"]}}
    return {} if kind == "plain" else mine


def main() -> None:
    manner, endpoint, run, keys = sys.argv[1:]
    act, kind = MANNERS[manner]
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
