"""Findings of the monitors of a run: what makes its results untrustworthy, and from when on."""

from __future__ import annotations

import h5py
import msgspec
import numpy as np

from gimpmd_schemas.wire.findings import Kind, Side


class RunFinding(msgspec.Struct, frozen=True, kw_only=True):
    """The first finding of a kind on a side; see `gimpmd_schemas.wire.findings`.

    Attributes
    ----------
    step, time : the coupling step at which a monitor made it, and its time.
    side : the side, or the whole body (``body``).
    kind : the monitor.
    value, limit : what it found, and the largest value that it accepts.
    place : where (length), one coordinate for each axis; null: the whole side.
    message : what the user was told.
    """

    step: int
    time: float
    side: Side
    kind: Kind
    value: float
    limit: float
    place: tuple[float, ...] | None
    message: str


def read_findings(file: h5py.File) -> tuple[RunFinding, ...]:
    """Read ``findings`` of ``run.h5``, in the order of the run; empty if there are none."""
    if "findings" not in file:
        return ()
    found = []
    for row in file["findings"][:]:
        place = tuple(float(x) for x in row["place"] if np.isfinite(x))
        found.append(
            RunFinding(
                step=int(row["step"]),
                time=float(row["time"]),
                side=row["side"].decode(),
                kind=row["kind"].decode(),
                value=float(row["value"]),
                limit=float(row["limit"]),
                place=place or None,
                message=row["message"].decode(),
            )
        )
    return tuple(found)
