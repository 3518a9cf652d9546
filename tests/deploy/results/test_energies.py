"""Energies from a record written by hand, and their balance."""

import h5py
import numpy as np
import pytest

from gimpmd_deploy.results.energies import RunEnergies, between
from tests.deploy.results.files import write_record


def read(path, *args, **kwargs):
    write_record(path / "run.h5", *args, **kwargs)
    with h5py.File(path / "run.h5") as file:
        return RunEnergies.read(file["series"])


def test_imbalance(tmp_path):
    energies = read(tmp_path, energies=[5.0, 6.9, 9.0], work=[0.0, 2.0, 4.0])
    np.testing.assert_allclose(energies.imbalance(), [0.0, 0.1, 0.0], atol=1e-15)
    assert energies.largest_imbalance() == pytest.approx(0.1 / 5.0)
    assert energies.scale() == (5.0, "initial energy")  # larger than the work
    np.testing.assert_array_equal(energies.kinetic, energies.md.kinetic)
    np.testing.assert_array_equal(energies.potential, 0.0)


def test_the_scale_is_the_external_work_where_that_is_larger(tmp_path):
    energies = read(tmp_path, energies=[1.0, 3.0, 9.0], work=[0.0, 2.0, 8.0])
    assert energies.scale() == (8.0, "external work")


def test_the_loss_at_the_interface_explains_an_imbalance(tmp_path):
    work = np.array([1.0, 0.8, 0.4])
    energies = read(tmp_path, [5.0, 4.8, 4.5], [0.0, 0.0, 0.0], interface_work=work)
    np.testing.assert_allclose(energies.interface_loss(), [0.0, 0.2, 0.6])
    assert energies.largest_imbalance() == pytest.approx(0.1)
    assert energies.remaining_imbalance() == pytest.approx(-0.02)


def test_balance_of_rest_is_zero(tmp_path):
    energies = read(tmp_path, energies=[0.0, 0.0, 0.0], work=[0.0, 0.0, 0.0])
    assert energies.largest_imbalance() == energies.remaining_imbalance() == 0.0


@pytest.mark.parametrize("dim", [2, 3])
def test_momentum_has_a_component_for_each_axis(tmp_path, dim):
    energies = read(tmp_path, [0.0] * 3, [0.0] * 3, dim=dim)
    assert energies.md.momentum.shape == (3, dim)
    np.testing.assert_array_equal(energies.total("momentum")[-1], np.arange(dim) + 1.0)


def test_gaps_are_interpolated_in_time():
    time, nan = np.array([0.0, 1.0, 3.0, 4.0]), np.nan
    np.testing.assert_allclose(between(time, np.array([0.0, nan, nan, 8.0])), 2.0 * time)
    assert np.isnan(between(time, np.full(4, nan))).all()


def test_to_dataframe(tmp_path):
    frame = read(tmp_path, [5.0, 6.9, 9.0], [0.0, 2.0, 4.0]).to_dataframe()
    assert list(frame["md_kinetic"]) == [5.0, 6.9, 9.0]
    assert {"time", "energy", "external_work", "md_momentum_x", "md_momentum_y"} <= set(frame)
