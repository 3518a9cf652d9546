"""Who may enter the bus with which keys, and what each role may do there."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from gimpmd_coupler.bus.connection import Answer, connect
from gimpmd_coupler.bus.hub import Request, Token, open_hub
from gimpmd_coupler.bus.keys import rank_settings, router_settings
from gimpmd_coupler.bus.settings import AT_ONCE, config
from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, PeerLostError
from gimpmd_schemas.wire.access import ONE_EACH
from tests.ports import free_port
from tests.services.coupler.test_bus import ask, receive, until

pytestmark = pytest.mark.timeout(60)

RANKS: dict[Role, int] = {"md": 2, "continuum": 2}

QUIET = 0.3
"""Seconds in which everything that is on its way arrives."""


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of the run."""
    folder = tmp_path_factory.mktemp("keys") / "keys"
    new_keys(folder, ["localhost", "127.0.0.1"], RANKS)
    return folder


@pytest.fixture(scope="module")
def other_keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of another run."""
    folder = tmp_path_factory.mktemp("other") / "keys"
    new_keys(folder, ["localhost", "127.0.0.1"], RANKS)
    return folder


@pytest.fixture
def seen() -> list[Request | Token]:
    """What has reached the coupler."""
    return []


@pytest.fixture
def endpoint(keys: Path, seen: list[Request | Token]) -> Iterator[str]:
    """A coupler that answers every request with its own content."""

    def answer(event: Request | Token) -> None:
        seen.append(event)
        if isinstance(event, Request):
            event.answer(event.data)

    place = f"tls/127.0.0.1:{free_port()}"
    with open_hub("test", answer, place, keys, ranks=RANKS) as where:
        yield where


@pytest.fixture
def enter(endpoint: str) -> Iterator[Callable[..., zenoh.Session]]:
    """Open a session with any settings, as an intruder would."""
    with ExitStack() as sessions:

        def begin(secure: dict[str, Any], place: str = endpoint) -> zenoh.Session:
            return sessions.enter_context(zenoh.open(config("client", place, secure, 1.0)))

        yield begin


@pytest.mark.parametrize(("role", "other_role"), [("md", "continuum"), ("continuum", "md")])
def test_both_roles_can_do_all_that_a_run_needs(
    role: Role, other_role: Role, keys: Path, endpoint: str
) -> None:
    """A payload may come twice: its sender repeats it when somebody begins to take it."""
    with (
        connect(endpoint, "test", role, 0, keys) as one,
        connect(endpoint, "test", other_role, 0, keys) as other,
    ):
        assert ask(one, "register", b"hello") == b"hello"
        other.subscribe([f"{role}/0"])
        one.publish(0, b"payload")
        assert receive(other).data == b"payload"
        other.ask_again(f"{role}/0", 0)
        assert receive(other).data == b"payload"


def test_the_coupler_of_a_run_that_is_recorded_gets_all_payloads(keys: Path) -> None:
    came: list[tuple[str, str, bytes]] = []
    place = f"tls/127.0.0.1:{free_port()}"
    with (
        open_hub(
            "test", lambda event: None, place, keys, lambda *one: came.append(one), RANKS
        ) as where,
        connect(where, "test", "md", 0, keys) as md,
        connect(where, "test", "continuum", 1, keys) as continuum,
    ):
        md.publish(0, b"from md")
        continuum.publish(0, b"from the continuum")
        until(lambda: len(set(came)) == 2)  # some may come twice
    assert sorted(set(came)) == [("continuum", "1", b"from the continuum"), ("md", "0", b"from md")]


STRANGERS = ["no certificate", "certificate of another run", "password of another run", "no TLS"]


@pytest.mark.parametrize("who", STRANGERS)
def test_strangers_stay_outside(
    who: str,
    keys: Path,
    other_keys: Path,
    endpoint: str,
    enter: Callable[..., zenoh.Session],
    seen: list[Request | Token],
) -> None:
    mine, others = rank_settings(keys, "md", 0), rank_settings(other_keys, "md", 0)
    tls, word = "transport/link/tls", "transport/auth/usrpwd/password"
    secure: dict[str, Any] = {
        "no certificate": {tls: {"root_ca_certificate": mine[tls]["root_ca_certificate"]}},
        "certificate of another run": mine | {tls: others[tls] | {"verify_name_on_connect": False}},
        "password of another run": mine | {word: others[word]},
        "no TLS": {},
    }[who]
    place = endpoint.replace("tls/", "tcp/") if who == "no TLS" else endpoint
    with pytest.raises(zenoh.ZError):
        enter(secure, place)
    assert seen == []


def test_keys_of_another_run_are_named_as_a_possible_reason(
    other_keys: Path, endpoint: str
) -> None:
    with (
        pytest.raises(PeerLostError, match=r"no coupler at tls/.* with these keys within 1 s"),
        connect(endpoint, "test", "md", 0, other_keys, 1.0),
    ):
        pass


def test_a_role_cannot_act_as_the_other(
    keys: Path,
    endpoint: str,
    enter: Callable[..., zenoh.Session],
    seen: list[Request | Token],
) -> None:
    """An MD rank that turns bad forges, spies and floods; the run does not notice."""
    heard: list[str] = []
    with (
        connect(endpoint, "test", "continuum", 0, keys) as continuum,
        connect(endpoint, "test", "md", 0, keys) as md,
    ):
        md.subscribe(["continuum/0"])
        bad = enter(rank_settings(keys, "md", 0))
        with ExitStack() as held:
            for key in ("**", "gimpmd/**", "gimpmd/test/answer/continuum/0"):
                spy = bad.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
                held.callback(spy.undeclare)
            token = bad.liveliness().declare_token("gimpmd/test/alive/continuum/7")
            held.callback(token.undeclare)
            assert ask(continuum, "register", b"hello") == b"hello"  # all of the above is settled
            time.sleep(QUIET)
            assert heard == []
            forged = [f"{kind}/continuum/0" for kind in ("register", "report", "failed", "data")]
            before = len(seen)
            for key in (*forged, "answer/continuum/0", "again/md/0", "other/x"):
                for _ in range(100):
                    bad.put(f"gimpmd/test/{key}", b"forged", attachment=bytes(16), **AT_ONCE)
            bad.put("gimpmd/another-run/register/md/0", b"forged")
            time.sleep(QUIET)
            assert len(seen) == before
            assert continuum.receive(QUIET) is None
            assert md.receive(QUIET) is None
            continuum.publish(0, b"real")
            assert receive(md).data == b"real"


def test_a_rank_cannot_act_as_another_of_its_role(
    keys: Path,
    endpoint: str,
    enter: Callable[..., zenoh.Session],
    seen: list[Request | Token],
) -> None:
    """Rank 0 of the atoms, or who has its keys, forges in the name of rank 1, before and after."""
    heard: list[str] = []
    bad, ear = (enter(rank_settings(keys, "md", 0)) for _ in range(2))
    forged = [f"{kind}/md/1" for kind in ("register", "report", "failed", "data")]

    def forge() -> None:
        for key in (*forged, "answer/md/1", "again/md/1"):
            bad.put(f"gimpmd/test/{key}", b"forged", attachment=bytes(15) + b"1", **AT_ONCE)
        time.sleep(QUIET)

    with ExitStack() as held:
        for key in ("answer/md/1", "again/md/1", "answer/md/*"):
            spied = f"gimpmd/test/{key}"
            spy = ear.declare_subscriber(spied, lambda sample: heard.append(str(sample.key_expr)))
            held.callback(spy.undeclare)
        token = bad.liveliness().declare_token("gimpmd/test/alive/md/1")
        held.callback(token.undeclare)
        forge()
        assert seen == []  # not its place, nor its sign of life
        with (
            connect(endpoint, "test", "continuum", 0, keys) as continuum,
            connect(endpoint, "test", "md", 1, keys) as md,
        ):
            continuum.subscribe(["md/1"])
            assert ask(md, "register", b"hello") == b"hello"
            before = len(seen)
            forge()
            assert len(seen) == before
            assert md.receive(QUIET) is None
            assert continuum.receive(QUIET) is None
            md.publish(0, b"real")
            assert receive(continuum).data == b"real"
        assert heard == []
        # what is its own it may do
        bad.put("gimpmd/test/failed/md/0", b"own", attachment=bytes(15) + b"1", **AT_ONCE)
        until(lambda: any(isinstance(e, Request) and e.data == b"own" for e in seen))


@pytest.mark.parametrize("rank", [2, 10])
def test_a_rank_without_keys_is_told_how_to_get_some(keys: Path, endpoint: str, rank: int) -> None:
    with (
        pytest.raises(InputError, match=rf"md-{rank}\.pem.*no such file(.|\n)*--ranks-md"),
        connect(endpoint, "test", "md", rank, keys),
    ):
        pass


def test_ranks_without_tls_must_use_a_folder_of_their_own(tmp_path: Path) -> None:
    def refused(endpoint: str) -> str:
        with (
            pytest.raises(InputError) as error,
            open_hub("test", lambda event: None, endpoint, tmp_path / "keys"),
        ):
            pass
        return str(error.value)

    assert "anybody could connect" in refused("tcp/127.0.0.1:7447")
    assert "there is no folder" in refused(f"unixsock-stream/{tmp_path}/none/socket")
    assert "has more than 107 bytes" in refused(f"unixsock-stream/{tmp_path}/{'x' * 107}")
    tmp_path.chmod(0o750)
    assert "other users may enter" in refused(f"unixsock-stream/{tmp_path}/socket")
    assert "there is no such file" in refused("tls/localhost:7447")


def test_a_socket_with_a_name_is_removed_at_the_end(tmp_path: Path) -> None:
    folder = tmp_path / "bus"
    folder.mkdir(mode=0o700)
    endpoint = f"unixsock-stream/{folder}/socket"

    def answer(event: Request | Token) -> None:
        if isinstance(event, Request):
            event.answer(b"yes")

    with open_hub("test", answer, endpoint) as where, connect(where, "test", "md", 0) as md:
        assert where == endpoint
        md.request("register", b"?")
        until(lambda: isinstance(md.receive(1.0), Answer))
    assert not any(folder.iterdir())


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another user")
def test_another_user_of_the_host_stays_outside() -> None:
    program = (
        "import os, socket, sys; os.setuid(int(sys.argv[2]));"
        " socket.socket(socket.AF_UNIX).connect(sys.argv[1])"
    )
    with open_hub("test", lambda event: None) as endpoint:
        words = [sys.executable, "-c", program, endpoint.removeprefix("unixsock-stream/")]
        assert subprocess.run([*words, "0"], check=False).returncode == 0
        done = subprocess.run([*words, "65534"], capture_output=True, text=True, check=False)
        assert "PermissionError" in done.stderr, done.stderr


@pytest.mark.parametrize("role", ["md", "continuum"])
def test_secrets_that_others_can_read_are_refused(role: Role, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    new_keys(folder, ["localhost"])
    rank_settings(folder, role, 0)
    router_settings(folder, "gimpmd/test", ONE_EACH)
    (folder / f"{role}-0.key").chmod(0o640)
    with pytest.raises(InputError, match=rf"{role}-0\.key = '-rw-r-----': other users can read"):
        rank_settings(folder, role, 0)
