"""The bus with one rank, where one process plays all others."""

from __future__ import annotations

import pytest

from gimpmd_coupler.bus.connection import Answer, Payload, connect
from gimpmd_coupler.bus.stage import Heard, Stage, open_stage
from gimpmd_schemas.errors import PeerLostError

pytestmark = pytest.mark.timeout(60)


def next_of(stage: Stage, kind: str) -> Heard:
    """The next of a kind that is heard."""
    while (heard := stage.heard.get(timeout=10.0)).kind != kind:
        pass
    return heard


def test_both_ends_hear_each_other() -> None:
    with open_stage("test", ["md/0"], ["continuum/0"]) as stage:
        with connect(stage.endpoint, "test", "md", 0) as rank:
            assert next_of(stage, "alive").who == "md/0"
            rank.request("register", b"let me in")
            asked = next_of(stage, "register")
            assert (asked.who, asked.data, len(asked.number)) == ("md/0", b"let me in", 16)
            stage.answer("md/0", b"for another", b"another number!!")
            stage.answer("md/0", b"come in", asked.number)
            assert rank.receive(10.0) == Answer(b"come in", asked=True)
            rank.subscribe(["continuum/0"])
            rank.publish(3, b"step 3")
            assert next_of(stage, "data").data == b"step 3"
            stage.ask_again("md/0", 3)
            assert next_of(stage, "data").data == b"step 3"
            rank.ask_again("continuum/0", 4)
            assert int.from_bytes(next_of(stage, "again").data, "little") == 4
            stage.send("continuum/0", b"step 4")
            assert rank.receive(10.0) == Payload("continuum/0", b"step 4")
        assert next_of(stage, "gone").who == "md/0"


def test_the_router_can_die() -> None:
    with (
        open_stage("test", ["md/0"], ["continuum/0"]) as stage,
        connect(stage.endpoint, "test", "md", 0) as rank,
    ):
        rank.request("register", b"let me in")
        next_of(stage, "register")
        stage.close()
        with pytest.raises(PeerLostError, match="is gone"):
            rank.receive(10.0)
