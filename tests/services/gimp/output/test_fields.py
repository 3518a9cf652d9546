"""VTKHDF files, read back by VTK itself."""

from __future__ import annotations

import subprocess
import sys

import h5py
import numpy as np
import pytest

from gimpmd_gimp.output.fields import PointsFile

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


@pytest.mark.parametrize("counts", [(7, 7, 7), (7, 9, 9, 4)])
def test_points_over_time(tmp_path, counts):
    """Points may change in number from one output to the next."""
    rng = np.random.default_rng(0)
    path = tmp_path / "points.vtkhdf"
    file = PointsFile(path, {"length": "sigma"})
    written = []
    for step, n in enumerate(counts):
        x, stress, zone = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), np.arange(n) + step
        file.append(0.5 * step, x, {"stress": stress, "zone": zone.astype(np.int32)})
        written.append((x, stress, zone))
    file.close()
    for step, (x, stress, zone) in enumerate(written):
        times, data, arrays = read(path, step)
        assert times == tuple(0.5 * k for k in range(len(counts)))
        assert data.GetNumberOfVerts() == len(x)
        points = np.array([data.GetPoint(i) for i in range(len(x))])
        assert points == pytest.approx(x, rel=1e-6)
        assert (arrays["stress"] == stress).all()
        assert (arrays["zone"] == zone).all()


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from gimpmd_gimp.output.fields import PointsFile
from gimpmd_schemas.errors import StorageError
path = Path(sys.argv[1])
file = PointsFile(path, {"length": "sigma"})
x = np.random.default_rng(1).normal(size=(5000, 3))
for step in range(3):
    file.append(0.5 * step, x + step, {"velocity": x})
size = path.stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))  # no file may grow beyond it
try:
    file.append(1.5, x, {"velocity": x})
except StorageError as error:
    print(error)
file.close()
"""


def test_a_full_disk_leaves_the_steps_before(tmp_path):
    """HDF5 alone damages its file, and often the process dies."""
    path = tmp_path / "points.vtkhdf"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True
    )
    assert "points.vtkhdf cannot be written: File too large" in done.stdout
    times, _, arrays = read(path, 2)
    assert times == (0.0, 0.5, 1.0)
    x = np.random.default_rng(1).normal(size=(5000, 3))
    assert (arrays["velocity"] == x).all()
    with h5py.File(path) as file:
        assert file["VTKHDF/Points"].shape == (5000 * 3, 3)
