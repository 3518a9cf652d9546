"""``schemas/protocol.md`` tells the truth about frames, messages and node ids."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest

from gimpmd_schemas.case.form import Role, SchemeName
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.fields import sent_fields
from gimpmd_schemas.wire.findings import MONITORS, Finding
from gimpmd_schemas.wire.messages import (
    MAGIC,
    PROTOCOL_VERSION,
    Accepted,
    Failed,
    Grant,
    Payload,
    Refused,
    Register,
    Report,
    StepReport,
    decode,
    encode,
)

TEXT = (Path(__file__).parents[2] / "schemas/protocol.md").read_text(encoding="utf-8")
SENT = Payload(role="continuum", rank=0, step=7)
VELOCITY = [[0.5, 0.0], [-1.0, 0.25]]
MESSAGES = [Register, Accepted, Refused, Payload, Report, Grant, Failed]


def dump(frame: bytes) -> str:
    """Classic hex dump: offset, sixteen bytes, their characters."""
    lines = []
    for start in range(0, len(frame), 16):
        part = frame[start : start + 16]
        shown = "".join(chr(byte) if 32 <= byte < 127 else "." for byte in part)
        lines.append(f"{start:04x}  {part.hex(' '):<47}  {shown}\n")
    return "".join(lines)


def test_the_example_is_what_we_send() -> None:
    frame = encode(SENT, {"velocity": np.array(VELOCITY)})
    (shown,) = re.findall(r"```hex\n(.*?)```", TEXT, re.DOTALL)
    assert shown == dump(frame)
    assert f"The checksum is `{int.from_bytes(frame[4:8], 'little'):08x}`" in TEXT


def test_the_example_is_what_we_read() -> None:
    (shown,) = re.findall(r"```hex\n(.*?)```", TEXT, re.DOTALL)
    frame = bytes.fromhex("".join(line[6:53] for line in shown.splitlines()))
    message, arrays = decode(frame, Payload)
    assert message == SENT
    assert arrays["velocity"].tolist() == VELOCITY


@pytest.mark.parametrize("message", MESSAGES)
def test_every_field_is_described(message: type[msgspec.Struct]) -> None:
    section = TEXT.split(f"### {message.__name__} ")[1].split("\n##")[0]
    cells = re.findall(r"^\| (`[^|]*) \|", section, re.MULTILINE)
    described = set(re.findall(r"`(\w+)`", " ".join(cells)))
    fields = {field.encode_name for field in msgspec.structs.fields(message)}
    assert fields <= described, fields - described


def test_version_magic_and_fields() -> None:
    assert f"version {PROTOCOL_VERSION}" in TEXT.splitlines()[0]
    assert f"`{MAGIC.decode()}`" in TEXT
    for scheme in get_args(SchemeName):
        for role in get_args(Role):
            (row,) = re.findall(rf"^\| `{scheme}` \| `{role}` \| (.*) \|$", TEXT, re.MULTILINE)
            fields = sent_fields(role, scheme)
            assert re.findall(r"`([a-z]+)`", row) == [field.name for field in fields]
            shapes = ["[n, d]" if field.rank else "[n]" for field in fields]
            assert re.findall(r"`(\[[^`]*\])`", row) == shapes


@pytest.mark.parametrize(
    ("cells", "nodes"),
    [
        ((7, 4), [(-2, -2), (0, 0), (3, 2), (9, 6)]),
        ((7, 4, 3), [(-2, -2, -2), (3, 2, 1), (9, 6, 5)]),
    ],
)
def test_node_ids(cells: tuple[int, ...], nodes: list[tuple[int, ...]]) -> None:
    dim = len(cells)
    grid = BackgroundGrid((1.0, -2.0, 0.5)[:dim], 0.5, cells, (False, True, False)[:dim])
    x = grid.positions()
    formula = re.findall(r"^    id = (.*)$", TEXT, re.MULTILINE)[dim - 2]
    for index in nodes:
        names = dict(zip("ijk", index, strict=False)) | {"cells": cells}
        node = eval(formula.replace(") (", ") * ("), {}, names)  # the formula of the text
        assert x[node].tolist() == [o + 0.5 * i for o, i in zip(grid.origin, index, strict=True)]


@pytest.mark.parametrize("part", [StepReport, Energies, Finding])
def test_parts_of_a_report_are_described(part: type[msgspec.Struct]) -> None:
    section = TEXT.split("### Report ")[1].split("\n##")[0]
    described = set(re.findall(r"`(\w+)`", section))
    assert {field.name for field in msgspec.structs.fields(part)} <= described


def test_all_kinds_of_findings_are_described() -> None:
    section = TEXT.split("### Report ")[1].split("\n##")[0]
    assert set(MONITORS) <= set(re.findall(r'`"([a-z ]+)"`', section))
