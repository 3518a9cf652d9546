"""What one rank of a service sends."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_coupler.bus.stage import Heard
from gimpmd_coupler.check.log import UnmetError
from gimpmd_coupler.check.rank import Rank
from gimpmd_schemas.wire.messages import PROTOCOL_VERSION, Payload, Register, encode


def registration(offers: np.ndarray, needs: np.ndarray) -> bytes:
    message = Register(
        protocol=PROTOCOL_VERSION, run="r", plan="p", role="md", rank=1, ranks=2, backend="b",
        units="lj", dt=1.0, patch=((0.0, 1.0),), host="h", pid=1, notes=(), first_step=0,
    )  # fmt: skip
    return encode(message, {"offers": offers, "needs": needs})


def heard(kind: str, frame: bytes) -> Heard:
    return Heard(kind, "md/1", frame, b"", 0.0)


def test_nodes_of_a_registration() -> None:
    rank = Rank("md", 1)
    assert rank.name == "md/1"
    rank.registrations.append(heard("register", registration(np.array([3, 1]), np.array([2]))))
    assert rank.registration(4).ranks == 2
    assert (rank.offers.tolist(), rank.needs.tolist()) == ([3, 1], [2])


@pytest.mark.parametrize(
    ("offers", "came"),
    [
        (np.array([4]), "offers with ids below 4, the number of nodes, came others too"),
        (np.array([-1]), "came others too"),
        (np.array([1.0]), "came float64 of shape"),
        (np.array([[1]]), "came int64 of shape"),
    ],
)
def test_nodes_that_are_none(offers: np.ndarray, came: str) -> None:
    rank = Rank("md", 1)
    rank.registrations.append(heard("register", registration(offers, np.array([2]))))
    with pytest.raises(UnmetError, match=came):
        rank.registration(4)


def test_a_payload_in_the_name_of_another_rank() -> None:
    frame = encode(Payload(role="md", rank=0, step=0), {})
    with pytest.raises(UnmetError, match="payloads of md/1 on its key, came one of md/0"):
        Rank("md", 1).take_payload(heard("data", frame), 0)
