"""Material points of a finished run, and of a file of three dimensions."""

import h5py
import numpy as np
import pytest

from gimpmd_deploy.results.points import PointsFile


def write(path, dim: int, counts: list[int]) -> None:
    """A file with other numbers of points at each output, laid out as VTKHDF lays it out."""
    n, voigt = sum(counts), {2: 3, 3: 6}[dim]
    rng = np.random.default_rng(1)
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root["NumberOfPoints"] = counts
        root["Points"] = rng.random((n, 3))
        root["Steps/Values"] = 0.5 * np.arange(len(counts))
        root["Steps/PartOffsets"] = np.arange(len(counts))
        root["Steps/PointOffsets"] = np.cumsum([0, *counts[:-1]])
        for name in ("reference", "displacement", "velocity"):
            root[f"PointData/{name}"] = rng.random((n, 3))
        for name in ("stress", "strain"):
            root[f"PointData/{name}"] = rng.random((n, voigt))
        root["PointData/size"] = rng.random((n, dim))
        root["PointData/level"] = np.arange(n)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_of_one_output(tmp_path, dim):
    path = tmp_path / "points.vtkhdf"
    write(path, dim, [4, 7, 5])
    file = PointsFile(path)
    assert (file.times, file.counts) == ([0.0, 0.5, 1.0], [4, 7, 5])
    points = file.read(1)
    assert (len(points), points.dim, points.time) == (7, dim, 0.5)
    assert points.stress.shape == (7, {2: 3, 3: 6}[dim])
    assert list(points.fields["level"]) == list(range(4, 11))
    with h5py.File(path) as raw:
        np.testing.assert_array_equal(points.position, raw["VTKHDF/Points"][4:11, :dim])
        np.testing.assert_array_equal(points.velocity, raw["VTKHDF/PointData/velocity"][4:11, :dim])


def test_points_of_a_run(block):
    points = block.points()
    assert len(points) == 1560
    np.testing.assert_allclose(
        points.position, points.reference + points.displacement, rtol=0, atol=1e-12
    )
    assert (points.size == 2.0).all()
