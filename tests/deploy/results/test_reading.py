"""Readers of what runs leave, on files written by hand."""

import h5py
import numpy as np
import pytest

from gimpmd_deploy.results.reading import AtomsFile, Series, find_time, lattice_of


def crystal(a: float, rows: int = 20) -> np.ndarray:
    """Hexagonal lattice."""
    sites = [
        (a * (i + 0.5 * (j % 2)), a * 3**0.5 / 2 * j) for j in range(rows) for i in range(rows)
    ]
    return np.array(sites)


def test_lattice_of_a_hexagonal_crystal():
    a = 1.1132
    spacing, area = lattice_of(crystal(a))
    assert spacing == pytest.approx(a, rel=1e-12)
    assert area == pytest.approx(a**2 * 3**0.5 / 2, rel=1e-12)


def test_lattice_of_a_square_crystal_with_a_hole():
    x, y = np.meshgrid(np.arange(30) * 2.0, np.arange(30) * 2.0)
    sites = np.stack([x.ravel(), y.ravel()], axis=1)
    sites = sites[np.hypot(*(sites - 29.0).T) > 8.0]
    assert lattice_of(sites) == pytest.approx((2.0, 4.0))


FRAME = """\
ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
4
ITEM: BOX BOUNDS ss ss pp
0 2
0 2
-0.5 0.5
ITEM: ATOMS id type x y z vx vy ux uy X0 Y0 sxx_area syy_area sxy_area
3 1 0 2.5 0 0 0 0 0.5 0 2 0 12 0
1 1 0.1 0 0 0 0 0.1 0 0 0 4 8 1
2 1 2 0 0 0 0 0 0 2 0 0 8 0
4 1 2 2 0 0 0 0 0 2 2 0 8 0
"""


def test_dump(tmp_path):
    path = tmp_path / "atoms.dump"
    path.write_text(FRAME.format(step=0) + FRAME.format(step=50))
    atoms = AtomsFile(path, timestep=0.02)
    assert atoms.times == [0.0, 1.0]
    frame = atoms.read(1)
    assert frame.time == 1.0
    np.testing.assert_array_equal(frame.site, [[0, 0], [2, 0], [0, 2], [2, 2]])
    np.testing.assert_array_equal(frame.displacement[[0, 2]], [[0.1, 0], [0, 0.5]])
    np.testing.assert_array_equal(frame.stress[0], [1, 2, 0.25])  # over an area of 4
    np.testing.assert_array_equal(frame.size, np.full((4, 2), 2.0))


def test_half_written_frame_is_left_out(tmp_path):
    path = tmp_path / "atoms.dump"
    path.write_text(FRAME.format(step=0) + FRAME.format(step=50)[:-8])
    assert AtomsFile(path, 0.02).times == [0.0]


def test_find_time():
    times = [0.0, 10.0, 20.0]
    assert find_time(times, 9.97, near=0.04) == 1
    assert find_time(times, 9.95, near=0.04) is None
    assert find_time([], 0.0, near=1.0) is None


def write_record(path, energies, work, interface_work=0.0):
    steps = len(work)
    with h5py.File(path, "w") as file:
        file.attrs.update(outcome="completed", start="2025-01-01T00:00:00+00:00")
        file.attrs["end"] = "2025-01-01T00:01:30+00:00"
        file["series/time"] = np.arange(steps) * 0.5
        file["series/md/kinetic"] = energies
        file["series/md/interface_work"] = np.zeros(steps) + interface_work
        file["series/total/energy"] = energies
        file["series/total/external_work"] = work
        file["series/total/dissipated"] = np.zeros(steps)
        file["timings/md/0/lammps"] = np.full(steps, 2.0)
        file["timings/md/1/lammps"] = np.full(steps, 4.0)
        file["memory/md/0"] = np.array([10, 30, 20])


def test_series(tmp_path):
    write_record(tmp_path / "run.h5", energies=[5.0, 6.9, 9.0], work=[0.0, 2.0, 4.0])
    series = Series.read(tmp_path / "run.h5")
    np.testing.assert_allclose(series.missing(), [0.0, 0.1, 0.0], atol=1e-15)
    assert series.balance() == pytest.approx(0.1 / 5.0)  # the energy at the start is larger
    assert series.timings["md"]["lammps"].tolist() == [3.0, 3.0, 3.0]
    assert series.memory == {"md/0": 30}
    assert series.seconds == 90.0


def test_what_the_interface_took_explains_missing_energy(tmp_path):
    work = np.array([1.0, 0.8, 0.4])
    write_record(tmp_path / "run.h5", [5.0, 4.8, 4.5], [0.0, 0.0, 0.0], interface_work=work)
    series = Series.read(tmp_path / "run.h5")
    np.testing.assert_allclose(series.taken(), [0.0, 0.2, 0.6])
    assert series.balance() == pytest.approx(0.1)
    assert series.unexplained() == pytest.approx(-0.02)


def test_balance_of_rest_is_zero(tmp_path):
    write_record(tmp_path / "run.h5", energies=[0.0, 0.0, 0.0], work=[0.0, 0.0, 0.0])
    assert Series.read(tmp_path / "run.h5").balance() == 0.0
