"""VTKHDF files that grow by one step at every output; ParaView opens them.

Points go to a temporal PolyData, nodes to a temporal ImageData (VTKHDF 2.2). Lengths, times and
velocities are in the units of the case, stresses in its pressure units.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from gimpmd_schemas.grid import PAD, BackgroundGrid, Floats

VERSION = (2, 2)
TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")


class PointsFile:
    """Material points over time: positions, and any number of point fields."""

    def __init__(self, path: Path, count: int, attributes: Mapping[str, str]) -> None:
        self._file = h5py.File(path, "w")
        self._count = count
        root = _root(self._file, "PolyData", attributes)
        root["NumberOfPoints"] = np.array([count], dtype=np.int64)
        _appendable(root, "Points", (3,))
        for name in TOPOLOGIES:
            cells = count if name == "Vertices" else 0
            group = root.create_group(name)
            group["NumberOfCells"] = np.array([cells], dtype=np.int64)
            group["NumberOfConnectivityIds"] = np.array([cells], dtype=np.int64)
            group["Connectivity"] = np.arange(cells, dtype=np.int64)
            group["Offsets"] = np.arange(cells + 1, dtype=np.int64)
        self._data = root.create_group("PointData")
        # the points never change in number: one part and one topology serve all steps
        self._steps = _steps(root)
        for name, columns in (("CellOffsets", (4,)), ("ConnectivityIdOffsets", (4,))):
            _appendable(self._steps, name, columns, np.int64)
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _appendable(self._steps, name, (), np.int64)

    def append(self, time: float, points: Floats, fields: Mapping[str, np.ndarray]) -> None:
        """Add a step: positions ``(n, 3)`` and fields of ``n`` rows."""
        root, steps = self._file["VTKHDF"], self._steps
        _append(root["Points"], points)
        _append(steps["PartOffsets"], np.zeros(1))
        _append(steps["NumberOfParts"], np.ones(1))
        _append(steps["PointOffsets"], np.array([steps.attrs["NSteps"] * self._count]))
        _append(steps["CellOffsets"], np.zeros((1, 4)))
        _append(steps["ConnectivityIdOffsets"], np.zeros((1, 4)))
        _finish_step(self._file, self._data, steps, time, self._count, fields)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class NodesFile:
    """The background grid over time, without its padding."""

    def __init__(self, path: Path, grid: BackgroundGrid, attributes: Mapping[str, str]) -> None:
        self._file = h5py.File(path, "w")
        self._grid = grid
        root = _root(self._file, "ImageData", attributes)
        nx, ny = grid.cells
        root.attrs["WholeExtent"] = np.array([0, nx, 0, ny, 0, 0])
        root.attrs["Origin"] = np.array([*grid.origin, 0.0])
        root.attrs["Spacing"] = np.array([grid.cell, grid.cell, 1.0])
        root.attrs["Direction"] = np.eye(3).ravel()
        self._data = root.create_group("PointData")
        self._steps = _steps(root)

    def append(self, time: float, fields: Mapping[str, Floats]) -> None:
        """Add a step: nodal fields of ``grid.size`` rows, in the order of node ids."""
        images = {}
        for name, field in fields.items():
            padded = field[: self._grid.size].reshape(*self._grid.shape, *field.shape[1:])
            image = np.moveaxis(padded[PAD:-PAD, PAD:-PAD], 0, 1)  # VTK counts x fastest
            images[name] = image[np.newaxis]
        _finish_step(self._file, self._data, self._steps, time, 1, images)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _root(file: h5py.File, kind: str, attributes: Mapping[str, str]) -> h5py.Group:
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(VERSION)
    root.attrs.create("Type", np.bytes_(kind), dtype=h5py.string_dtype("ascii", len(kind)))
    file.attrs.update(attributes)
    return root


def _steps(root: h5py.Group) -> h5py.Group:
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    _appendable(steps, "Values", ())
    steps.create_group("PointDataOffsets")
    return steps


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


def _finish_step(
    file: h5py.File,
    data: h5py.Group,
    steps: h5py.Group,
    time: float,
    rows: int,
    fields: Mapping[str, np.ndarray],
) -> None:
    """Append the fields, then count the step: a reader never sees half of one."""
    done = int(steps.attrs["NSteps"])
    for name, field in fields.items():
        if name not in data:
            shape = field.shape[1:]
            chunk = (1, *shape) if rows == 1 else (1024, *shape)
            data.create_dataset(
                name, (0, *shape), field.dtype, maxshape=(None, *shape), chunks=chunk
            )
            _appendable(steps["PointDataOffsets"], name, (), np.int64)
        _append(data[name], field)
        _append(steps["PointDataOffsets"][name], np.array([done * rows]))
    _append(steps["Values"], np.array([time]))
    steps.attrs["NSteps"] = done + 1
    file.flush()
