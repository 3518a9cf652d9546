"""A replay: what is played back to a side of a run, and what that side has sent in return."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.on_disk import write_at_once

REPLAY = "replay"
"""Folder of these files in the run folder of a replay."""

SETTINGS = "settings.json"


class Replay(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a replay.

    Attributes
    ----------
    recording : full path of the recording.
    side : the side that is played back.
    tolerance : largest difference that is accepted, by field of the other side (units of the
        field). Empty: all bits must be the same.
    goes_on : whether the replay goes on after a difference that is not accepted.
    """

    recording: str
    side: Role
    tolerance: dict[str, float] = {}
    goes_on: bool = False


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """A field of a payload that differs from the recorded one.

    Attributes
    ----------
    step : coupling step of the payload.
    rank : its sender, such as ``md/0``.
    field : name of the field.
    largest : largest absolute difference (units of the field); 0 if only signs of zeros differ.
    nodes : how many nodes have other bits.
    """

    step: int
    rank: str
    field: str
    largest: float
    nodes: int


class Compared(msgspec.Struct, frozen=True, kw_only=True):
    """What a rank of the side that is played back has compared.

    Attributes
    ----------
    payloads : how many payloads, of one rank each.
    differing : how many of them differ by more than is accepted.
    first : the first difference that is not accepted, or null.
    largest : the largest difference of each field, also where it is accepted.
    """

    payloads: int
    differing: int
    first: Difference | None
    largest: dict[str, Difference]


def keep_larger(largest: dict[str, Difference], found: Difference) -> None:
    """Keep a difference if it is the first or the largest one of its field."""
    known = largest.get(found.field)
    if known is None or found.largest > known.largest:
        largest[found.field] = found


def merged(parts: Iterable[Compared]) -> Compared:
    """Put together what all ranks have compared."""
    parts = list(parts)
    firsts = [part.first for part in parts if part.first is not None]
    largest: dict[str, Difference] = {}
    for part in parts:
        for found in part.largest.values():
            keep_larger(largest, found)
    return Compared(
        payloads=sum(part.payloads for part in parts),
        differing=sum(part.differing for part in parts),
        first=min(firsts, key=lambda one: (one.step, one.rank), default=None),
        largest=largest,
    )


def write_settings(run_dir: Path, settings: Replay) -> None:
    """Write the settings into the run folder of a replay."""
    (run_dir / REPLAY).mkdir(exist_ok=True)
    write_at_once(run_dir / REPLAY / SETTINGS, msgspec.json.encode(settings))


def load_settings(run_dir: Path) -> Replay:
    """Read the settings from the run folder of a replay.

    Raises
    ------
    InputError
        They are missing, or cannot be understood.
    """
    path = run_dir / REPLAY / SETTINGS
    try:
        return msgspec.json.decode(path.read_bytes(), type=Replay)
    except (OSError, msgspec.DecodeError) as error:
        hint = "gimpmd replay writes this file"
        raise InputError(str(path), [Problem("replay", None, str(error), hint)]) from None


def write_result(run_dir: Path, rank: int, compared: Compared) -> None:
    """Write what a rank has compared."""
    write_at_once(run_dir / REPLAY / f"rank{rank}.json", msgspec.json.encode(compared))


def load_result(run_dir: Path) -> Compared:
    """Read what all ranks have compared, as far as they have written it."""
    paths = sorted((run_dir / REPLAY).glob("rank*.json"))
    return merged(msgspec.json.decode(path.read_bytes(), type=Compared) for path in paths)
