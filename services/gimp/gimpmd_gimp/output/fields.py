"""VTKHDF files that grow by one step at every output, for ParaView.

Material points or nodes are written as a temporal PolyData (VTKHDF 2.2). Lengths, times and
velocities are in the units of the case, stresses in its pressure units.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError, StorageError
from gimpmd_schemas.held_file import HeldFile

VERSION = (2, 2)
TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")


class PointsFile:
    """Points over time: positions and any number of fields. The number of points may change.

    Parameters
    ----------
    path : Path
    attributes : mapping
        Attributes of the file: its units.
    lengths : mapping, optional
        To go on with an earlier file: the `lengths` that it had. What came later is cut off.

    Raises
    ------
    BackendError
        The earlier file is gone, damaged, or shorter.
    StorageError
        A new file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        attributes: Mapping[str, str],
        lengths: Mapping[str, int] | None = None,
    ) -> None:
        if lengths is None:
            self._create(path, attributes)
        else:
            self._go_on(path, lengths)

    def _go_on(self, path: Path, lengths: Mapping[str, int]) -> None:
        try:
            self._held = HeldFile(path, "r+")
            self._file = h5py.File(self._held, "r+")
            for name, length in lengths.items():
                if self._file[name].shape[0] < length:
                    raise OSError(f"{name} has {self._file[name].shape[0]} rows, not {length}")
                self._file[name].resize(length, axis=0)
        except (OSError, KeyError, StorageError) as error:
            raise BackendError(
                f"{path} is not as it was at the checkpoint ({error}); put the file back to go on"
            ) from error
        self._root = root = self._file["VTKHDF"]
        self._data, self._steps = root["PointData"], root["Steps"]
        self._steps.attrs["NSteps"] = self._steps["Values"].shape[0]
        self._cells = int(root["Vertices/NumberOfCells"][:].sum())
        self._commit()

    def lengths(self) -> dict[str, int]:
        """Rows of every data set."""
        found: dict[str, int] = {}

        def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset):
                found[name] = int(item.shape[0])

        self._file.visititems(visit)
        return found

    def _create(self, path: Path, attributes: Mapping[str, str]) -> None:
        self._held = HeldFile(path, "w")
        self._file = h5py.File(self._held, "w")
        self._file.attrs.update(attributes)
        root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array(VERSION)
        kind = np.bytes_("PolyData")
        root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
        _appendable(root, "NumberOfPoints", (), np.int64)
        _appendable(root, "Points", (3,))
        for name in TOPOLOGIES:
            group = root.create_group(name)
            for column in ("NumberOfCells", "NumberOfConnectivityIds", "Connectivity", "Offsets"):
                _appendable(group, column, (), np.int64)
        self._data = root.create_group("PointData")
        self._steps = steps = root.create_group("Steps")
        steps.attrs["NSteps"] = 0
        _appendable(steps, "Values", ())
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _appendable(steps, name, (), np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            _appendable(steps, name, (len(TOPOLOGIES),), np.int64)
        steps.create_group("PointDataOffsets")
        self._root = root
        self._cells = 0  # number of vertices of all parts so far

    def append(self, time: float, points: Floats, fields: Mapping[str, np.ndarray]) -> None:
        """Add a step: positions ``(n, 3)`` and fields of ``n`` rows.

        Raises
        ------
        StorageError
            There is no space, or the file was deleted. The file keeps the steps before.
        """
        root, steps, count = self._root, self._steps, points.shape[0]
        parts = root["NumberOfPoints"]
        if len(parts) == 0 or parts[-1] != count:
            self._add_part(count)
        first = self._cells - count
        start = len(root["Points"])
        _append(root["Points"], points)
        _append(steps["PartOffsets"], np.array([len(parts) - 1]))
        _append(steps["NumberOfParts"], np.ones(1))
        _append(steps["PointOffsets"], np.array([start]))
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            _append(steps[name], np.array([[first, 0, 0, 0]]))
        for name, field in fields.items():
            if name not in self._data:
                _appendable(self._data, name, field.shape[1:], field.dtype)
                _appendable(steps["PointDataOffsets"], name, (), np.int64)
            _append(self._data[name], field)
            _append(steps["PointDataOffsets"][name], np.array([start]))
        _append(steps["Values"], np.array([time]))
        steps.attrs["NSteps"] = int(steps.attrs["NSteps"]) + 1
        self._commit()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._held.close()

    def _commit(self) -> None:
        self._file.flush()
        self._held.commit()

    def _add_part(self, count: int) -> None:
        """Add a part with one vertex for each of ``count`` points; steps of that size share it."""
        _append(self._root["NumberOfPoints"], np.array([count]))
        for name in TOPOLOGIES:
            cells = count if name == "Vertices" else 0
            group = self._root[name]
            _append(group["NumberOfCells"], np.array([cells]))
            _append(group["NumberOfConnectivityIds"], np.array([cells]))
            _append(group["Connectivity"], np.arange(cells))
            _append(group["Offsets"], np.arange(cells + 1))
        self._cells += count


def _appendable(
    group: h5py.Group, name: str, columns: tuple[int, ...], dtype: type | np.dtype = np.float64
) -> h5py.Dataset:
    return group.create_dataset(
        name, (0, *columns), dtype, maxshape=(None, *columns), chunks=(1024, *columns)
    )


def _append(dataset: h5py.Dataset, rows: np.ndarray) -> None:
    start = dataset.shape[0]
    dataset.resize(start + rows.shape[0], axis=0)
    dataset[start:] = rows
