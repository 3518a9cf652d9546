"""Who is refused, and why, stands in the log of the coupler."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh

from gimpmd_coupler.bus.keys import rank_settings
from gimpmd_coupler.bus.refusals import Reader
from gimpmd_coupler.bus.settings import AT_ONCE, config
from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.errors import STOPPED
from tests.ports import free_port

pytestmark = pytest.mark.timeout(60)

TLS, USER = "transport/link/tls", "transport/auth/usrpwd/user"
WORD = "transport/auth/usrpwd/password"
SECONDS = 20.0

FIRST = "127.0.0.1 with the certificate of md/0"
WRONG_SIDE = "certificate and password belong to different sides"
REASONS = {
    "no certificate": "refused a connection: it has no certificate",
    "other authority": "refused a connection: its certificate is not one of this run",
    "keys of another run": "it has keys of another run",
    "no TLS": "refused a connection: it does not speak TLS",
    "wrong password": f"refused {FIRST}: wrong password",
    "no password": f"refused {FIRST}: it has no password",
    "wrong user": f"refused {FIRST}: wrong user",
    "wrong role": f"refused {FIRST}: {WRONG_SIDE}",
    "forbidden key": f"refused a message of {FIRST}: it is not allowed",
    "another rank": "refused a message of 127.0.0.1 with the certificate of md/1: it is not",
}


def intrude(manner: str, endpoint: str, mine: Path, another: Path) -> None:
    """Try to enter in one manner, or to do what is forbidden."""
    ours, others = rank_settings(mine, "md", 0), rank_settings(another, "md", 0)
    continuum = rank_settings(mine, "continuum", 0)
    authority = {"root_ca_certificate": ours[TLS]["root_ca_certificate"]}
    secure: dict[str, Any] = {
        "no certificate": {TLS: authority},
        "other authority": ours | {TLS: others[TLS] | authority},
        "keys of another run": others,
        "no TLS": {},
        "wrong password": ours | {WORD: others[WORD]},
        "no password": {TLS: ours[TLS]},
        "wrong user": ours | {USER: "somebody"},
        "wrong role": continuum | {TLS: ours[TLS]},
        "forbidden key": ours,
        "another rank": rank_settings(mine, "md", 1),
    }[manner]
    place = endpoint.replace("tls/", "tcp/") if manner == "no TLS" else endpoint
    if manner in ("wrong role", "forbidden key", "another rank"):
        key = "data/md/0" if manner == "another rank" else "data/continuum/0"
        with zenoh.open(config("client", place, secure, 5.0)) as session:
            session.put(f"gimpmd/test/{key}", b"forged", **AT_ONCE)
            time.sleep(0.2)
    else:
        with pytest.raises(zenoh.ZError):
            zenoh.open(config("client", place, secure, 0.5))


def test_each_refusal_is_logged_with_its_reason(start: Callable[..., Any], tmp_path: Path) -> None:
    mine, another = tmp_path / "keys", tmp_path / "another"
    for folder in (mine, another):
        new_keys(folder, ["localhost", "127.0.0.1"], {"md": 2, "continuum": 1})
    run = start("--listen", f"tls/127.0.0.1:{free_port()}", "--keys", str(mine))
    log = tmp_path / "logs" / "coupler.log"
    for manner, reason in REASONS.items():
        intrude(manner, run.endpoint, mine, another)
        deadline = time.monotonic() + SECONDS
        while reason not in log.read_text():
            assert time.monotonic() < deadline, f"{manner}: no {reason!r} in\n{log.read_text()}"
            time.sleep(0.05)
    words = [path.read_text().strip() for path in mine.glob("*.password")]
    assert len(words) == 2
    assert not any(word in log.read_text() for word in words)


def test_events_still_go_to_standard_output(start: Callable[..., Any]) -> None:
    """Zenoh writes its log there, and must not write between the events."""
    run = start()
    assert {line["type"] for line in run.coupler.lines} <= {"Alive", "Listening"}
    run.coupler.process.stdin.close()
    assert run.coupler.end() == STOPPED
    assert run.coupler.find(type="Ended")


STAMP = "\x1b[2m2026-11-29T10:50:09.260298Z\x1b[0m"
ACCEPT = "DEBUG app-0 ThreadId(02) zenoh_transport::unicast::establishment::accept:"


def connected(port: int, host: str = "10.0.0.7") -> str:
    words = f"Accepted TLS connection on 10.0.0.1:7447: {host}:{port}. Common Name: md."
    return f"{STAMP} DEBUG app-0 ThreadId(02) zenoh_link_tls::unicast: {words}"


def let_in(peer: str) -> str:
    link = "Link { src: tls/10.0.0.1:7447, dst: tls/10.0.0.7:1, mtu: 49152 }"
    return f"{STAMP} {ACCEPT} New transport link accepted from {peer} to cc7b: {link}"


def refused(peer: str) -> str:
    sender = f"demux{{zid=cc7b src=south:0:client/{peer}:1}}"
    place = "zenoh::net::routing::interceptor"
    return f"{STAMP} TRACE  rx-0 ThreadId(08) {sender}: {place}: Msg intercepted!"


def test_of_several_that_have_not_been_let_in_all_are_named() -> None:
    reader = Reader()
    assert reader.read(connected(1)) == ""
    assert reader.read(connected(2, "10.0.0.8")) == ""
    said = reader.read(f"{STAMP} {ACCEPT} UsrPwd extension - Recv. Invalid password. at /x.rs:1.")
    one, other = (f"10.0.0.{i} with the certificate of md" for i in (7, 8))
    assert said == f"refused {one} or {other}: wrong password"


def test_who_was_let_in_is_not_named_for_another() -> None:
    reader = Reader()
    reader.read(connected(1))
    assert reader.read(let_in("a86b1e1b7d4132d2aa7a134bbfadbbf0")) == ""
    reader.read(connected(2, "10.0.0.8"))
    said = reader.read(f"{STAMP} {ACCEPT} UsrPwd extension - Recv. Invalid user. at /x.rs:1.")
    assert said == "refused 10.0.0.8 with the certificate of md: wrong user"
    said = reader.read(refused("a86b1e1b"))
    assert said.startswith("refused a message of 10.0.0.7 with the certificate of md:")


@pytest.mark.parametrize(
    ("peer", "short"),
    [
        ("a86b1e1b7d4132d2aa7a134bbfadbbf0", "a86b1e1b"),
        ("bb9c01fac771749a1faf53ed2d13730", "bb9c01f"),
        ("1fac771749a1faf53ed2d137300", "1fa"),
    ],
)
def test_the_sender_of_a_message_is_found_with_zeros_in_front_of_its_id(
    peer: str, short: str
) -> None:
    """Zenoh writes numbers of 32 digits, and of 8 in the short form, both without such zeros."""
    reader = Reader()
    reader.read(connected(1))
    reader.read(let_in(peer))
    said = reader.read(refused(short))
    assert said.startswith("refused a message of 10.0.0.7 with the certificate of md:")


def test_other_warnings_of_zenoh_are_kept() -> None:
    line = f"{STAMP}  WARN rx-0 ThreadId(08) zenoh_transport::unicast: Congested. at /src/x.rs:12."
    assert Reader().read(line) == "Zenoh warns: Congested"
    assert Reader().read("something else") == "something else"
