"""``run.h5``: the record of a run, with one row per coupling step in every data set.

===================================  ===========================================================
data set                             content
===================================  ===========================================================
``/series/step``, ``/series/time``   coupling step and time
``/series/<role>/<quantity>``        sums over the ranks of one side (`fields.ENERGY_FIELDS`);
                                     vectors have one data set per component (``momentum_x``, ...)
``/series/total/<quantity>``         the whole body (`fields.TOTAL_FIELDS`)
``/timings/<role>/<phase>``          wall seconds since the previous step, one column per rank;
                                     ``wait`` is time spent on the bus
``/memory/<role>``                   largest resident set so far, one column per rank
``/findings``                        what monitors found, one row for the first of each kind on each
                                     side or about the whole body (`FINDING`); not there if there
                                     is nothing
===================================  ===========================================================

A column is zero at steps at which its rank had no such phase, or did not take part in the run.

Every data set of numbers has the attribute ``units``. Attributes of the file: ``gimpmd`` (version),
``format`` (version of this layout), ``case`` (text of the case file), ``units`` (style),
``notes`` (what the user should know about the results, one sentence each; not there if there is
nothing), ``start`` and ``end`` (UTC, ISO 8601; no ``end`` while the run goes on), ``wall_time``
(seconds up to the last flush, without pauses before a run was resumed) and ``outcome``
(``running``, ``completed``, ``stopped``, ``stopped: ...`` with the reason, or ``failed: ...`` with
the culprit).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.held_file import HeldFile
from gimpmd_schemas.mechanics.units import UNITS, Units
from gimpmd_schemas.on_disk import write_at_once
from gimpmd_schemas.record_format import FORMAT_VERSION, check_format
from gimpmd_schemas.wire.energies import Energies, from_components
from gimpmd_schemas.wire.fields import ENERGY_FIELDS, STEP_FIELDS, TOTAL_FIELDS
from gimpmd_schemas.wire.findings import Finding, Kind, Side
from gimpmd_schemas.wire.messages import Array

FLUSH_SECONDS = 3.0
"""Least time between two flushes: what a killed run loses of its record. The first step is flushed
at once."""

FLUSH_SHARE = 0.02
"""Largest share of the time that flushes take. One takes about 15 ms with a few ranks."""

_OUTCOME_ROOM = 1000
"""Characters of an outcome that can be written although the file cannot grow."""

_CHUNK_ROWS = 1024
_CHUNK_BYTES = 2**16
"""Largest size of a chunk, if one row is not larger: each flush writes the last chunk again."""

_PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""How memory is stored, which seldom changes. Timings are too noisy to be worth the time."""

FINDING = np.dtype(
    [
        ("step", "i8"),
        ("time", "f8"),
        ("side", "S16"),
        ("kind", "S32"),
        ("value", "f8"),
        ("limit", "f8"),
        ("place", "f8", 3),  # NaN where there is no coordinate
        ("message", "S1024"),
    ]
)
"""A row of ``/findings``; see `gimpmd_schemas.wire.findings`."""

_SERIES = {
    name: field
    for field in (*STEP_FIELDS, *ENERGY_FIELDS, *TOTAL_FIELDS)
    for name in field.components(3)
}


def _unit_and_type(path: str, units: Units) -> tuple[str, np.dtype[Any]]:
    """Unit and type of a data set, given by its group and name."""
    group, leaf = path.split("/")[1], path.rsplit("/", 1)[1]
    if group == "timings":
        return "s", np.dtype("f4")  # more digits than such times are good for
    if group == "memory":
        return "byte", np.dtype("i8")
    return _SERIES[leaf].unit_in(units), np.dtype("i8" if leaf == "step" else "f8")


class Recorder:
    """Writes ``run.h5``.

    Steps are collected and written together with each flush, so that the file on disk is complete
    between two flushes whatever happens to the process. If there is no space for a flush, the file
    keeps the state of the one before it.

    Parameters
    ----------
    path : Path
    case_text : str
        The case file as it stands in the run folder.
    style : str
        Unit style of LAMMPS.
    earlier : tuple of Path and int, optional
        For a run that goes on from a checkpoint: the record in the checkpoint, and how many of its
        steps count.

    Attributes
    ----------
    path : Path

    Raises
    ------
    StorageError
        There is no space, or the file was deleted; also raised by ``add``, ``flush`` and ``close``.
    InputError
        The earlier record has another format.
    """

    def __init__(
        self, path: Path, case_text: str, style: str, earlier: tuple[Path, int] | None = None
    ) -> None:
        self.path, self._units = path, UNITS[style]
        self._waiting: dict[str, list[tuple[int, Array]]] = {}  # first step and values, by path
        self._datasets: dict[str, h5py.Dataset] = {}
        self._notes: list[str] = []  # added in other threads, written with the next flush
        self._written = self._added = 0  # steps
        self._flush_at = 0.0  # not before the first step, but at once after it
        self._began = time.monotonic()
        if earlier is not None:
            self._go_on(*earlier)
            return
        self._held = HeldFile(path, "w")
        self._file = h5py.File(self._held, "w")
        self._file.attrs.update(
            gimpmd=version("gimpmd"),
            format=FORMAT_VERSION,
            case=case_text,
            units=style,
            start=datetime.now(UTC).isoformat(),
            wall_time=0.0,
        )
        _end_with(self._file, " " * _OUTCOME_ROOM)  # HDF5 keeps the room, for a disk that is full
        self._file.attrs["outcome"] = "running"
        del self._file.attrs["end"]
        self._commit()

    def _go_on(self, record: Path, steps: int) -> None:
        """Go on with a copy of an earlier record, up to a number of steps."""
        with h5py.File(record) as file:
            check_format(record, file)
        write_at_once(self.path, record.read_bytes())
        self._held = HeldFile(self.path, "r+")
        self._file = h5py.File(self._held, "r+")
        self._notes = [str(sentence) for sentence in self._file.attrs.get("notes", ())]
        self._file.attrs["outcome"] = "running"
        self._began -= self._file.attrs["wall_time"]
        self._written = self._added = steps

        def cut(path: str, item: h5py.Dataset | h5py.Group) -> None:
            if path == "findings":
                earlier = item[item["step"] < steps]
                item.resize(earlier.shape)
                item[:] = earlier
            elif isinstance(item, h5py.Dataset):
                item.resize(steps, axis=0)
                self._datasets[f"/{path}"] = item

        self._file.visititems(cut)
        self._commit()

    def add(self, columns: Mapping[str, Array]) -> None:
        """Add the next steps.

        Parameters
        ----------
        columns : mapping of str to ndarray, shape ``(n,)`` or ``(n, ranks)``
            Values at n steps by the path of their data set. A path left out counts as zero.
        """
        for path, values in columns.items():
            self._waiting.setdefault(path, []).append((self._added, values))
        self._added += len(next(iter(columns.values())))
        if time.monotonic() > self._flush_at:
            self.flush()

    def note(self, sentences: tuple[str, ...]) -> None:
        """Add sentences to the notes, each of them once."""
        self._notes += [sentence for sentence in sentences if sentence not in self._notes]

    def sides(self, role: Role, steps: Sequence[int]) -> list[Energies | None]:
        """Energies of a side at steps on record; None where it had none."""
        if not steps:
            return []
        series = self._file[f"series/{role}"]
        columns = {name: series[name][:][steps].tolist() for name in series}
        rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
        return [from_components(row) for row in rows]

    def add_finding(
        self, side: Side, finding: Finding, step: int, time: float, message: str
    ) -> None:
        """Add a finding at a step and time, and what the user was told."""
        if "findings" not in self._file:
            self._file.create_dataset("findings", shape=(0,), maxshape=(None,), dtype=FINDING)
        place = (*(finding.place or ()), math.nan, math.nan, math.nan)[:3]
        rows = self._file["findings"]
        rows.resize((rows.size + 1,))
        value, limit = finding.value, finding.limit
        text = message.encode()  # in UTF-8
        rows[-1] = (step, time, side, finding.kind, value, limit, place, text)
        self._commit()

    def told(self) -> dict[tuple[Side, Kind], str]:
        """What the user was told of the findings so far, by side and kind, in their order."""
        rows = self._file["findings"][:] if "findings" in self._file else ()
        return {
            (row["side"].decode(), row["kind"].decode()): row["message"].decode() for row in rows
        }

    def flush(self) -> None:
        """Write all steps added so far."""
        start = time.monotonic()
        for path, pieces in self._waiting.items():
            if path not in self._datasets:
                self._datasets[path] = self._create(path, pieces[0][1].shape[1:])
        for dataset in self._datasets.values():
            dataset.resize(self._added, axis=0)  # new rows are zero
        for path, pieces in self._waiting.items():
            self._write(self._datasets[path], pieces)
        self._waiting, self._written = {}, self._added
        if self._notes:
            self._file.attrs["notes"] = self._notes
        self._commit()
        now = time.monotonic()
        self._flush_at = now + max(FLUSH_SECONDS, (now - start) / FLUSH_SHARE)

    def _write(self, dataset: h5py.Dataset, pieces: list[tuple[int, Array]]) -> None:
        """Write what has been added of a data set, as one piece."""
        columns = pieces[0][1].shape[1:]
        rows = np.zeros((self._added - self._written, *columns), dataset.dtype)
        for step, values in pieces:
            first = step - self._written
            rows[first : first + len(values)] = values
        if dataset.shape[1:] < columns:  # the run goes on with more ranks
            dataset.resize((self._added, *columns))
        dataset[(slice(self._written, None), *map(slice, columns))] = rows

    def _commit(self) -> None:
        self._file.attrs.modify("wall_time", time.monotonic() - self._began)
        self._file.flush()
        self._held.commit()

    def _create(self, path: str, columns: tuple[int, ...]) -> h5py.Dataset:
        unit, dtype = _unit_and_type(path, self._units)
        most = _CHUNK_BYTES // (dtype.itemsize * math.prod(columns))
        dataset = self._file.create_dataset(
            path,
            shape=(self._written, *columns),  # zero at the steps before this quantity appeared
            maxshape=(None, *(None for _ in columns)),
            chunks=(min(_CHUNK_ROWS, max(1, most)), *columns),
            dtype=dtype,
            **(_PACKED if unit == "byte" else {}),
        )
        dataset.attrs["units"] = unit
        return dataset

    def close(self, outcome: str) -> None:
        """Write the remaining steps and the outcome of the run."""
        try:
            self.flush()
            _end_with(self._file, outcome)
            self._file.close()
            self._held.commit()
        finally:
            self.drop()

    def drop(self) -> None:
        """Close the file as the last flush left it."""
        if self._file:
            self._file.close()
        self._held.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._file:  # not closed with an outcome
            self.close("failed: the coupler itself")


def conclude(path: Path, outcome: str) -> None:
    """Note the outcome of a run, unless its record tells of a good end.

    Raises
    ------
    StorageError
        There is no space even for that.
    OSError
        The file is damaged.
    """
    with closing(HeldFile(path, "r+")) as held:
        with h5py.File(held, "r+") as file:
            if not file.attrs["outcome"].startswith(("running", "failed")):
                return
            _end_with(file, outcome)
        held.commit()


def _end_with(file: h5py.File, outcome: str) -> None:
    """Note how the run ended, and when."""
    file.attrs["outcome"] = outcome
    file.attrs["end"] = datetime.now(UTC).isoformat()
