"""Frames: round trips, and damage of every kind is told as `ProtocolError`."""

from __future__ import annotations

import io
import json
import struct
import zlib
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire import messages
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    Accepted,
    Failed,
    Grant,
    Message,
    Payload,
    Refused,
    Register,
    Report,
    StepReport,
    decode,
    encode,
    read_frame,
)

text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
number = st.floats(allow_nan=False, allow_infinity=False)
whole = st.integers(0, 2**53)
role = st.sampled_from(["md", "continuum"])
pair = st.tuples(number, number)

any_energies = st.builds(
    Energies,
    **dict.fromkeys(set(Energies.__struct_fields__) - {"momentum"}, number),
    momentum=st.lists(number, min_size=2, max_size=3).map(tuple),
)
any_step = st.builds(
    StepReport,
    step=whole,
    energies=st.none() | any_energies,
    timings=st.dictionaries(text, number, max_size=4),
)
any_report = st.builds(
    Report,
    role=role,
    rank=whole,
    steps=st.lists(any_step, max_size=3).map(tuple),
    peak_memory=whole,
    waits_for=st.lists(text, max_size=2).map(tuple),
)
any_message: st.SearchStrategy[Message] = st.one_of(
    st.builds(
        Register,
        protocol=whole,
        run=text,
        plan=text,
        role=role,
        rank=whole,
        ranks=whole,
        backend=text,
        units=text,
        dt=number,
        patch=st.tuples(pair, pair),
        host=text,
        pid=whole,
    ),
    st.builds(
        Accepted,
        first_step=whole,
        last_step=whole,
        granted=whole,
        sources=st.lists(whole, max_size=3).map(tuple),
    ),
    st.builds(Grant, granted=whole, last=whole, done=whole),
    st.builds(Refused, reason=text, lost=text),
    st.builds(Payload, role=role, rank=whole, step=whole),
    any_report,
    st.builds(Failed, role=role, rank=whole, message=text, exit_code=whole, culprit=text),
)
any_array = npst.arrays(
    st.sampled_from(["<f8", ">f8", "<f4", "<i8", ">i8", "<i4", "u1", "?"]),
    npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5),
)
any_arrays = st.dictionaries(text, any_array, max_size=4)


PAYLOAD = Payload(role="md", rank=0, step=1)


def same(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    """Equal in shape and, not-a-number included, in every element."""
    little = a.astype(a.dtype.newbyteorder("<"))
    return a.shape == b.shape and little.dtype == b.dtype and little.tobytes() == b.tobytes()


@given(any_message, any_arrays)
def test_round_trip(message: Message, arrays: dict[str, np.ndarray[Any, Any]]) -> None:
    got, back = decode(encode(message, arrays), type(message))
    assert got == message
    assert list(back) == list(arrays)
    assert all(same(arrays[name], back[name]) for name in arrays)
    assert all(not array.flags.writeable for array in back.values())


def test_arrays_need_not_be_contiguous() -> None:
    array = np.arange(24.0).reshape(4, 6)[::2, ::-3]
    _, back = decode(encode(PAYLOAD, {"v": array}), Payload)
    assert same(array, back["v"])


@pytest.mark.parametrize("dtype", ["O", "U3", "c16", "M8[s]", "i4,f8"])
def test_only_plain_numbers_are_sent(dtype: str) -> None:
    with pytest.raises(TypeError, match=r"'odd'.*cannot be sent"):
        encode(PAYLOAD, {"odd": np.zeros(2, dtype)})


SAMPLE_REPORT = Report(
    role="md", rank=0, peak_memory=1,
    steps=(
        StepReport(
            step=6,
            energies=Energies(
                kinetic=1.5, potential=2.0, external_work=0.0, interface_work=0.5,
                dissipated=0.25, mass=1.0, momentum=(0.0, 1.0),
            ),
            timings={"wait": 0.1},
        ),
    ),
)  # fmt: skip
SAMPLE = encode(
    SAMPLE_REPORT,
    {"mass": np.arange(3.0), "velocity": np.ones((3, 2)), "none": np.zeros((0, 2))},
)


@given(st.integers(0, len(SAMPLE) - 1))
def test_truncated(length: int) -> None:
    with pytest.raises(ProtocolError):
        decode(SAMPLE[:length], Report)


@pytest.mark.parametrize("bit", range(8))
def test_every_flipped_bit_is_noticed(bit: int) -> None:
    for place in range(len(SAMPLE)):
        damaged = bytearray(SAMPLE)
        damaged[place] ^= 1 << bit
        with pytest.raises(ProtocolError):
            decode(bytes(damaged), Report)


@given(st.binary(max_size=300), st.booleans())
def test_random_bytes(data: bytes, marked: bool) -> None:
    with pytest.raises(ProtocolError):
        decode(messages.MAGIC + data if marked else data, Report)


@given(st.binary(min_size=1, max_size=64))
def test_trailing_bytes(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(SAMPLE + data, Report)


def sealed(header: bytes, rest: bytes = b"") -> bytes:
    """A frame whose checksum is right, whatever it holds."""
    body = struct.pack("<I", len(header)) + header
    body += b"\0" * (-(len(body) + 8) % 8) + rest
    return b"GMD1" + struct.pack("<I", zlib.crc32(body)) + body


def with_array(dtype: str, shape: Any, times: int = 1, rest: bytes = b"\0" * 16) -> bytes:
    """A well-sealed payload that claims an array."""
    info = {"name": "v", "dtype": dtype, "shape": shape}
    message = {"type": "Payload", "role": "md", "rank": 0, "step": 1}
    return sealed(json.dumps({"message": message, "arrays": [info] * times}).encode(), rest)


def test_what_a_crafted_frame_should_look_like() -> None:
    _, arrays = decode(with_array("<f8", [2]), Payload)
    assert arrays["v"].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    "frame",
    [
        with_array("<f8", [3]),  # beyond the end
        with_array("<f8", [1]),  # bytes left over
        with_array("<f8", [-1]),
        with_array("<f8", [2.5]),
        with_array("<f8", [2**62, 2**62]),  # the product overflows to zero
        with_array("<f8", [0, 2**62, 2**62]),
        with_array("<f8", [1] * 70),
        with_array("|u1", [2**63 - 1]),  # once overflowed the bounds check of NumPy
        with_array("|u1", [2**40, 0], rest=b""),
        with_array("<f8", [1], times=2),  # one name twice
        with_array("O", [2]),
        with_array(">f8", [2]),
        with_array("(2,", [1]),
        with_array("i4,f8", [1]),
        sealed(b""),
        sealed(b"{}"),
        sealed(b"null"),
        sealed(b"\xff\xfe"),
        sealed(b'{"message":{"type":"Failed","role":"md","rank":0,"message":"\xff"}}'),
        sealed(b'{"a":' * 100_000),
        sealed(b"[" * 100_000),
        sealed(b'{"message":{"type":"Unheard"},"arrays":[]}'),
        sealed(b'{"message":{"type":"Grant","granted":1e999,"last":1,"done":1},"arrays":[]}'),
        sealed(b'{"message":{"type":"Payload","role":"fem","rank":0,"step":1},"arrays":[]}'),
    ],
)
def test_well_sealed_nonsense(frame: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(frame, Payload)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["message", "arrays", "type", "step", "name", "dtype", "shape"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@given(json_values, st.binary(max_size=32))
def test_well_sealed_random_headers(header: Any, rest: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(sealed(json.dumps(header).encode(), rest), Payload)


def test_another_kind_of_message_is_named() -> None:
    frame = encode(Refused(reason="no"))
    with pytest.raises(ProtocolError, match="Refused instead of Accepted or Grant"):
        decode(frame, (Accepted, Grant))


def test_numbers_that_are_not_finite_do_not_pass() -> None:
    """JSON has none; the frame that would carry one is not understood."""
    step = msgspec.structs.replace(SAMPLE_REPORT.steps[0], timings={"wait": float("nan")})
    frame = encode(msgspec.structs.replace(SAMPLE_REPORT, steps=(step,)))
    with pytest.raises(ProtocolError, match=r"message\.steps\[0\]\.timings"):
        decode(frame, Report)


@given(st.lists(st.tuples(any_message, any_arrays), max_size=3))
def test_a_file_of_frames_is_read_frame_by_frame(
    sent: list[tuple[Message, dict[str, np.ndarray[Any, Any]]]],
) -> None:
    frames = [encode(*one) for one in sent]
    file = io.BytesIO(b"".join(frames))
    assert [read_frame(file) for _ in range(len(frames) + 1)] == [*frames, b""]


@pytest.mark.parametrize("left", [1, 11, 12, 40, -8, -1])
def test_a_file_that_was_cut_off_ends_before_the_frame_that_is_not_whole(left: int) -> None:
    frame = encode(PAYLOAD, {"v": np.arange(4.0)})
    file = io.BytesIO(frame + frame[:left])
    assert (read_frame(file), read_frame(file)) == (frame, b"")


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        pytest.param(b"HDF5" + bytes(100), "begins with b'HDF5'", id="another file"),
        pytest.param(b"GMD1" + b"\xff" * 100, "header of 4294967307 bytes", id="long header"),
        pytest.param(b"GMD1" + struct.pack("<II", 0, 2) + b"[]", "not understood", id="no header"),
        pytest.param(
            encode(PAYLOAD, {"v": np.zeros((10, 10))}).replace(b"[10,10]", b"[9999999,99]"),
            "not understood|message of",
            id="absurd shape",
        ),
    ],
)
def test_what_is_no_frame_is_not_read(data: bytes, reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        read_frame(io.BytesIO(data))
