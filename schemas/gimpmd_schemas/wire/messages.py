"""Messages on the bus: a JSON header, then raw little-endian arrays (``schemas/protocol.md``).

A frame is ``b"GMD1"``, the CRC-32 of all bytes that follow it, the header's length (both
little-endian uint32), the header, zero bytes up to a multiple of eight, and the arrays one after
another, each padded with zero bytes to a multiple of eight.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Annotated, Any, BinaryIO, Literal, TypeVar, cast, get_args

import msgspec
import numpy as np
from zlib_ng.zlib_ng import crc32

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding

PROTOCOL_VERSION = 4
MAGIC = b"GMD1"
ALIGN = 8

MAX_MESSAGE = 256 * 2**20
"""Largest frame, bytes. Zenoh drops larger frames silently, so we refuse to send them."""

Array = np.ndarray[Any, np.dtype[Any]]

Member = tuple[Role, int]
"""Role and number of a rank."""


class Register(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A rank asks to take part in the run. Arrays: ``offers`` and ``needs``, node ids (int64).

    Attributes
    ----------
    notes : what the user should know about the results, one sentence each.
    first_step : step of the checkpoint from which the rank goes on; 0 without one.
    """

    protocol: int
    run: str
    plan: str
    role: Role
    rank: int
    ranks: int
    backend: str
    units: str
    dt: float
    patch: Box
    host: str
    pid: int
    notes: tuple[str, ...] = ()
    first_step: int = 0


class Accepted(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The rank takes part.

    Arrays, for each rank r in ``sources``: ``rows_r`` and ``places_r`` (int64). Row ``rows_r[i]``
    of the fields of rank r belongs to node ``needs[places_r[i]]``.

    Attributes
    ----------
    first_step, last_step : first and last step of the run.
    granted : step up to which the rank may advance; see `Grant`.
    sources : ranks of the other side whose fields this rank needs.
    """

    first_step: int
    last_step: int
    granted: int
    sources: tuple[int, ...]


class Grant(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """How far ranks may go; the answer to a `Report`.

    Attributes
    ----------
    granted : step up to which all ranks may advance without asking.
    last : last step of the run; lower than announced if the user stops the run.
    done : all ranks have reported this step, so nobody asks for payloads of earlier ones.
    recall : whether the grant is taken back: the rank stays where it stands and reports that step.
    checkpoints : steps at which the rank saves its state, once it has completed them.
    """

    granted: int
    last: int
    done: int
    recall: bool = False
    checkpoints: tuple[int, ...] = ()


class Refused(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The rank, or the whole run, cannot go on.

    Attributes
    ----------
    reason : why, as text for the user.
    lost : name of the rank whose death is the reason, or empty.
    """

    reason: str
    lost: str = ""


class StepReport(msgspec.Struct, frozen=True, kw_only=True):
    """Energies, timings and findings of a rank at a step.

    Attributes
    ----------
    step : coupling step.
    energies : conserved quantities of this rank; null at steps without energies.
    timings : wall seconds since the previous step by phase; ``wait`` is time spent on the bus.
    findings : what the monitors of this rank found at this step.
    """

    step: int
    energies: Energies | None
    timings: dict[str, float]
    findings: tuple[Finding, ...] = ()


class Saved(msgspec.Struct, frozen=True, kw_only=True):
    """A rank has saved its state.

    Attributes
    ----------
    step : coupling step.
    digest : SHA-256 of the file, in hex.
    """

    step: int
    digest: str


class Report(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """What a rank has done since its last report.

    Attributes
    ----------
    steps : completed steps, one after another; may be empty.
    peak_memory : largest resident set so far, bytes.
    waits_for : names of ranks whose payloads this rank has been waiting for.
    holds : after a recall, the step at which this rank stays until the next grant; null otherwise.
    saved : checkpoints that the rank has saved since its last report.
    stop : whether somebody has asked this rank to end the run.
    """

    role: Role
    rank: int
    steps: tuple[StepReport, ...]
    peak_memory: int
    waits_for: tuple[str, ...] = ()
    holds: int | None = None
    saved: tuple[Saved, ...] = ()
    stop: bool = False


class Payload(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """State of a rank at step k. Arrays: the fields of the scheme on the nodes it offers."""

    role: Role
    rank: int
    step: int


class Failed(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A rank reports an error that ends it. The coupler then ends the run.

    Attributes
    ----------
    culprit : name of another rank that is at fault as this one says, or empty.
    """

    role: Role
    rank: int
    message: str
    exit_code: int
    culprit: str = ""


Message = Register | Accepted | Grant | Refused | Report | Payload | Failed
M = TypeVar("M", bound=Message)


Dtype = Literal["<f8", "<f4", "<i8", "<i4", "|u1", "|b1"]


class ArrayInfo(msgspec.Struct, frozen=True):
    """One array of a frame: its name, element type and shape (C order)."""

    name: str
    dtype: Dtype
    shape: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0)], ...], msgspec.Meta(max_length=8)]


class Header(msgspec.Struct, frozen=True):
    """The header of a frame: a message, and the arrays that follow it in this order."""

    message: Message
    arrays: tuple[ArrayInfo, ...]


_DTYPES = {name: np.dtype(name) for name in get_args(Dtype)}
_LEAD = struct.Struct("<4sII")  # magic, CRC-32, length of the header
_LENGTH = struct.Struct("<I")
_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(Header)


def _padding(length: int) -> bytes:
    return b"\0" * (-length % ALIGN)


def encode(message: Message, arrays: Mapping[str, Array] | None = None) -> bytes:
    """Pack a message and its arrays into one frame.

    Raises
    ------
    TypeError
        An array's element type is not one of `Dtype`.
    """
    infos: list[ArrayInfo] = []
    blobs: list[bytes | memoryview] = []
    for name, array in (arrays or {}).items():
        dtype = array.dtype.newbyteorder("<").str
        if dtype not in _DTYPES:
            raise TypeError(f"array {name!r} of {dtype} cannot be sent; use one of {[*_DTYPES]}")
        little = np.asarray(array, dtype=_DTYPES[dtype], order="C")
        infos.append(ArrayInfo(name, cast(Dtype, dtype), little.shape))
        blobs += [little.data, _padding(little.nbytes)]
    header = _encoder.encode(Header(message, tuple(infos)))
    pieces = [header, _padding(_LEAD.size + len(header)), *blobs]
    crc = crc32(_LENGTH.pack(len(header)))
    for piece in pieces:
        crc = crc32(piece, crc)
    return b"".join([_LEAD.pack(MAGIC, crc, len(header)), *pieces])


def decode(data: bytes, expected: type[M] | tuple[type[M], ...]) -> tuple[M, dict[str, Array]]:
    """Unpack a frame; the arrays are read-only views of ``data``.

    Raises
    ------
    ProtocolError
        The frame has another format, is damaged, or holds another kind of message.
    """
    _, expected_crc, length = _lead(data)
    crc = crc32(memoryview(data)[8:])
    if crc != expected_crc:
        raise ProtocolError(
            f"message damaged: its checksum is {crc:08x}, it should be {expected_crc:08x}"
        )
    end = _LEAD.size + length
    header = _header(data[_LEAD.size : end])
    arrays = _arrays(data, end + len(_padding(end)), header.arrays)
    if not isinstance(header.message, expected):
        kinds = expected if isinstance(expected, tuple) else (expected,)
        names = " or ".join(kind.__name__ for kind in kinds)
        raise ProtocolError(f"got a message {type(header.message).__name__} instead of {names}")
    return header.message, arrays


def read_frame(file: BinaryIO) -> bytes:
    """Read the next frame of a file that contains frames one after another.

    Its checksum is left to `decode`.

    Returns
    -------
    bytes
        Empty at the end of the file, also if the last frame is not whole.

    Raises
    ------
    ProtocolError
        What follows is no frame.
    """
    lead = file.read(_LEAD.size)
    if len(lead) < _LEAD.size:
        return b""
    start = _LEAD.size + _lead(lead)[2]
    if start > MAX_MESSAGE:
        raise ProtocolError(f"message header of {start} bytes")
    text = file.read(start - _LEAD.size)
    if len(text) < start - _LEAD.size:
        return b""
    end = start + len(_padding(start))
    for info in _header(text).arrays:
        size = math.prod(info.shape) * _DTYPES[info.dtype].itemsize
        end += size + -size % ALIGN
    if end > MAX_MESSAGE:
        raise ProtocolError(f"message of {end} bytes")
    rest = file.read(end - start)
    return b"".join((lead, text, rest)) if len(rest) == end - start else b""


def _lead(data: bytes) -> tuple[bytes, int, int]:
    """Magic, checksum, and length of the header."""
    if data[:4] != MAGIC or len(data) < _LEAD.size:
        raise ProtocolError(f"not a gimpmd message: it begins with {data[:4]!r}, not {MAGIC!r}")
    magic, crc, length = _LEAD.unpack_from(data)
    return magic, crc, length


def _header(text: bytes) -> Header:
    try:
        return _decoder.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(f"message header not understood: {error}") from None


def _arrays(data: bytes, offset: int, infos: tuple[ArrayInfo, ...]) -> dict[str, Array]:
    """Return views of the arrays. They must fill the rest of the frame exactly."""
    arrays: dict[str, Array] = {}
    for info in infos:
        if info.name in arrays:
            raise ProtocolError(f"array {info.name!r} appears twice in the message")
        # in Python's integers: the bounds check of np.ndarray overflows
        dtype = _DTYPES[info.dtype]
        size = math.prod(info.shape) * dtype.itemsize
        if max(info.shape, default=0) > len(data) or offset + size > len(data):
            raise ProtocolError(
                f"array {info.name!r} of shape {info.shape} does not fit the message of"
                f" {len(data)} bytes"
            )
        arrays[info.name] = np.ndarray(info.shape, dtype, data, offset)
        offset += size + -size % ALIGN
    if offset != len(data):
        raise ProtocolError(f"message has {len(data)} bytes, its header describes {offset}")
    return arrays
