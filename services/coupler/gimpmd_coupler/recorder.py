"""``run.h5``: the record of a run, one value per coupling step in every data set.

========================================  =====================================================
data set                                  content
========================================  =====================================================
``/series/step``, ``/series/time``        coupling step and time
``/series/<role>/<quantity>``             ledger of one side: kinetic, potential, external_work,
                                          interface_work, dissipated, mass, momentum_x,
                                          momentum_y
``/series/total/energy``                  kinetic and potential energy of all sides
``/series/total/external_work``           work done on all sides since the start
``/series/total/dissipated``              energy turned into heat on purpose since the start
``/series/total/balance``                 ``(W - D - (E - E0)) / max(|W|, |E0|)``
``/timings/<role>/<rank>/<phase>``        wall seconds since the step before; ``wait`` is time
                                          spent on the bus
``/memory/<role>/<rank>``                 largest resident set so far
========================================  =====================================================

Every data set has the attribute ``units``. Attributes of the file: ``gimpmd`` (version),
``format`` (version of this layout), ``case`` (text of the case file), ``units`` (style),
``start`` and ``end`` (UTC, ISO 8601; no ``end`` while the run goes on) and ``outcome``
(``running``, ``completed``, ``stopped``, or ``lost ...`` and ``failed ...`` with the culprit).
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Self

import h5py

from gimpmd_schemas.mechanics.units import UNITS, Units

FORMAT_VERSION = 1
FLUSH_SECONDS = 10.0
"""A run that is killed loses no more than this. A flush takes a core for some 15 ms."""

_CHUNK = 1024


def _unit(path: str, units: Units) -> str:
    """Unit of a data set, by its group and name."""
    group, leaf = path.split("/")[1], path.rsplit("/", 1)[1]
    if group == "timings":
        return "s"
    if group == "memory":
        return "byte"
    return {
        "step": "1",
        "balance": "1",
        "time": units.time,
        "mass": units.mass,
        "momentum_x": f"{units.mass} {units.length}/{units.time}",
        "momentum_y": f"{units.mass} {units.length}/{units.time}",
    }.get(leaf, units.energy)


class Recorder:
    """Writes ``run.h5``.

    Rows are collected and written together with a flush, so that the file on disk is whole
    between two flushes whatever happens to the process.

    Parameters
    ----------
    path : Path
    case_text : str
        The case file as it stands in the run folder.
    style : str
        Unit style.
    """

    def __init__(self, path: Path, case_text: str, style: str) -> None:
        self._units = UNITS[style]
        self._rows: list[Mapping[str, float]] = []
        self._datasets: dict[str, h5py.Dataset] = {}
        self._written = 0
        self._flushed = time.monotonic()
        # without a lock, so that the file can be read while the run goes on
        self._file = h5py.File(path, "w", locking=False)
        self._file.attrs.update(
            gimpmd=version("gimpmd"),
            format=FORMAT_VERSION,
            case=case_text,
            units=style,
            start=datetime.now(UTC).isoformat(),
            outcome="running",
        )
        self._file.flush()

    def add(self, row: Mapping[str, float]) -> None:
        """Add one step: values by the path of their data set; a path left out counts as zero."""
        self._rows.append(row)
        if time.monotonic() - self._flushed > FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write what has been added so far."""
        for path in dict.fromkeys(path for row in self._rows for path in row):
            if path not in self._datasets:
                self._datasets[path] = self._create(path)
        count = self._written + len(self._rows)
        for path, dataset in self._datasets.items():
            dataset.resize((count,))
            dataset[self._written :] = [row.get(path, 0) for row in self._rows]
        self._rows, self._written = [], count
        self._file.flush()
        self._flushed = time.monotonic()

    def _create(self, path: str) -> h5py.Dataset:
        whole = path == "/series/step" or path.startswith("/memory/")
        dataset = self._file.create_dataset(
            path,
            shape=(self._written,),  # steps before this quantity appeared are zero
            maxshape=(None,),
            chunks=(_CHUNK,),
            dtype="i8" if whole else "f8",
        )
        dataset.attrs["units"] = _unit(path, self._units)
        return dataset

    def close(self, outcome: str) -> None:
        """Write the rest and how the run ended."""
        self.flush()
        self._file.attrs["outcome"] = outcome
        self._file.attrs["end"] = datetime.now(UTC).isoformat()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._file:  # nobody had the time to say how the run ended
            self.close("failed: the coupler itself")
