"""VTKHDF files, read back by VTK itself."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.fields import NodesFile, PointsFile
from gimpmd_schemas.grid import BackgroundGrid

vtk = pytest.importorskip("vtk")


def read(path, step):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    times = reader.GetExecutive().GetOutputInformation(0).Get(key)
    reader.UpdateTimeStep(times[step])
    data = reader.GetOutputDataObject(0)
    fields = data.GetPointData()
    arrays = {
        fields.GetArrayName(i): vtk_to_numpy(fields.GetArray(i))
        for i in range(fields.GetNumberOfArrays())
    }
    return times, data, arrays


def test_points_over_time(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "points.vtkhdf"
    file = PointsFile(path, 7, {"length": "sigma"})
    written = []
    for step in range(3):
        x, stress, zone = rng.normal(size=(7, 3)), rng.normal(size=(7, 3)), np.arange(7) + step
        file.append(0.5 * step, x, {"stress": stress, "zone": zone.astype(np.int32)})
        written.append((x, stress, zone))
    file.close()
    for step, (x, stress, zone) in enumerate(written):
        times, data, arrays = read(path, step)
        assert times == (0.0, 0.5, 1.0)
        assert data.GetNumberOfVerts() == 7
        points = np.array([data.GetPoint(i) for i in range(7)])
        assert points == pytest.approx(x, rel=1e-6)
        assert (arrays["stress"] == stress).all()
        assert (arrays["zone"] == zone).all()


def test_nodes_over_time(tmp_path):
    grid = BackgroundGrid((1.0, 2.0), 0.5, (4, 3), (False, False))
    path = tmp_path / "nodes.vtkhdf"
    file = NodesFile(path, grid, {})
    x = grid.positions()
    for step in range(2):
        file.append(1.0 * step, {"mass": x[:, 0] + 10.0 * x[:, 1] + 100.0 * step})
    file.close()
    for step in range(2):
        _, data, arrays = read(path, step)
        assert data.GetDimensions() == (5, 4, 1)
        points = np.array([data.GetPoint(i) for i in range(20)])
        assert arrays["mass"] == pytest.approx(points[:, 0] + 10.0 * points[:, 1] + 100.0 * step)
