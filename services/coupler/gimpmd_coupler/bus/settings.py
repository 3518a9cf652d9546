"""Settings of both ends of the bus, and the keys on it.

The settings follow measurements on Zenoh 1.10: no discovery, no shared memory, a short lease, long
queues.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
from collections.abc import Mapping
from typing import Any, Literal, get_args

import zenoh

from gimpmd_schemas.wire.messages import MAX_MESSAGE

Kind = Literal["register", "report", "failed"]
"""Kinds of requests."""
KINDS: tuple[Kind, ...] = get_args(Kind)

Mode = Literal["client", "router"]
"""Part of a process in the network: ranks are clients, the coupler is the router."""

UNASKED = bytes(16)
"""Number of a message of the coupler that answers no request."""

CONNECT_SECONDS = 5.0
"""Time after which a rank that finds no coupler gives up."""

RECONNECT_SECONDS = 2.0
"""Time after which a broken connection counts as lost."""

AT_ONCE: dict[str, Any] = {
    "express": True,
    "congestion_control": zenoh.CongestionControl.DROP,
}
"""How everything is published. What a receiver does not take is dropped: see `_PATIENCE`."""

_PATIENCE = {"client": (30.0, 600.0), "router": (0.1, 1.0)}
"""Seconds for which a full queue may accept nothing before a frame is dropped: for its first part
of 64 KB, and in addition for all further parts (Zenoh doubles the wait with each part).

A rank waits for the router. The router does not wait for a rank that takes nothing, because all
others would wait with it; what an honest rank misses it asks for again. While it waits it reads
nothing, so both times and a period of the signs of life must be shorter than `_LEASE_MS`, or the
router takes the others for dead.
"""

_THREADS = {
    "client": "(rx: (handover: app), tx: (handover: app), net: (handover: app),"
    " acc: (handover: app), app: (worker_threads: 1))",
    "router": "(rx: (worker_threads: 1), tx: (handover: app), net: (handover: app),"
    " acc: (handover: app), app: (worker_threads: 1))",
}
_LEASE_MS = 2000


def prefix(run: str) -> str:
    """Return what all keys of a run begin with.

    Raises
    ------
    ValueError
        See `check_run_id`.
    """
    return f"gimpmd/{check_run_id(run)}"


def check_run_id(run: str) -> str:
    """Return the run id if it can be part of a key.

    Raises
    ------
    ValueError
        It is empty or contains characters with a special meaning on the bus.
    """
    if not re.fullmatch(r"[A-Za-z0-9._-]+", run):
        raise ValueError(f"run id {run!r} must be made of letters, digits and . _ -")
    return run


def tune_process(mode: Mode) -> None:
    """Set process options that matter more for the speed than our own work.

    In a client one thread does all work of Zenoh, because waking several threads in turn doubles
    the time of a round trip. A router has another thread that receives: it waits when the queue to
    a client is full, and would wait for ever if it had to empty that queue itself. Large buffers
    stay mapped, because fresh pages for every message cost more time than sending it.

    What the environment says about the threads does not count: a process started by a client has
    the client's setting there, and a router with that setting loses payloads.
    """
    os.environ["ZENOH_RUNTIME"] = _THREADS[mode]
    m_trim_threshold, m_top_pad, m_mmap_threshold = -1, -2, -3
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc only
        mallopt(m_mmap_threshold, 32 << 20)
        mallopt(m_trim_threshold, 512 << 20)
        mallopt(m_top_pad, 32 << 20)


def config(
    mode: Mode,
    endpoint: str,
    secure: Mapping[str, Any] | None = None,
    patience: float = CONNECT_SECONDS,
) -> zenoh.Config:
    """Return the configuration of a session.

    Parameters
    ----------
    mode : a router listens at the endpoint, a client connects to it.
    endpoint : Zenoh's name of the place, such as ``tls/node7:7447``.
    secure : further settings, from ``keys``; must be given for TLS.
    patience : seconds after which a client that finds no router gives up.
    """
    part, whole = _PATIENCE[mode]
    settings = {
        "mode": mode,
        "listen/endpoints": [endpoint] if mode == "router" else [],
        "connect/endpoints": [endpoint] if mode == "client" else [],
        "connect/timeout_ms": int(1000 * patience),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 20,
            "period_max_ms": 200,
            "period_increase_factor": 2,
        },
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": 5000,
        "transport/unicast/accept_timeout": 5000,
        "transport/link/protocols": [endpoint.split("/", maxsplit=1)[0]],
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/congestion_control/drop": {
            "wait_before_drop": int(1e6 * part),
            "max_wait_before_drop_fragments": int(1e6 * whole),
        },
        "transport/link/rx/max_message_size": MAX_MESSAGE,
        "adminspace/enabled": False,
        "plugins_loading/enabled": False,
        **(secure or {}),
    }
    made = zenoh.Config()
    for key, value in settings.items():
        made.insert_json5(key, json.dumps(value))
    return made


def direct(function: Any) -> Any:
    """Let Zenoh call from its own thread, which saves a thread switch. For clients.

    The function must neither block nor publish: a queue of Zenoh is emptied by the thread that
    calls it, which would wait for itself. The router's own thread must not run Python at all,
    because it would wait for the interpreter while ranks wait for payloads.
    """
    return zenoh.handlers.Callback(function, indirect=False)
