"""Material points over time, from ``fields/points.vtkhdf``."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from gimpmd_deploy.results.particles import Particles


class PointsFile:
    """Material points over time; their number may change from one output to the next.

    Attributes
    ----------
    times : list of float
        Times of the outputs.
    counts : list of int
        Number of points at each of them.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with h5py.File(path) as file:
            self.times: list[float] = file["VTKHDF/Steps/Values"][:].tolist()
            steps = file["VTKHDF/Steps"]
            counts = file["VTKHDF/NumberOfPoints"][:]
            self.counts: list[int] = counts[steps["PartOffsets"][:]].tolist()

    def read(self, index: int) -> Particles:
        """Return the points at one output."""
        with h5py.File(self.path) as file:
            root = file["VTKHDF"]
            start = int(root["Steps/PointOffsets"][index])
            rows = slice(start, start + self.counts[index])
            data = {name: values[rows] for name, values in root["PointData"].items()}
            position = root["Points"][rows].astype(np.float64)
        size = data.pop("size").astype(np.float64)
        dim = size.shape[1]  # the file pads vectors to three components
        reference, displacement, velocity = (
            data.pop(name)[:, :dim].astype(np.float64)
            for name in ("reference", "displacement", "velocity")
        )
        return Particles(
            time=self.times[index],
            reference=reference,
            position=position[:, :dim],
            displacement=displacement,
            velocity=velocity,
            stress=data.pop("stress").astype(np.float64),
            size=size,
            fields=data,
        )
