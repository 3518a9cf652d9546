"""Planes and the pairs of atoms across them."""

import numpy as np
import pytest

from gimpmd_deploy.analysis.plane import Plane, bonds_across
from tests.deploy.analysis.fields import SPACING, hexagonal, turned


def test_coordinates():
    plane = Plane.through((1.0, 2.0), (3.0, 4.0))
    x = np.array([[1.0, 2.0], [1.6, 2.8], [0.2, 2.6]])
    assert plane.position(x) == pytest.approx([0.0, 1.0, 0.0])
    assert plane.height(x) == pytest.approx([0.0, 0.0, 1.0])


def test_three_dimensions_need_a_normal():
    plane = Plane.through((0, 0, 0), (0, 0, 2), normal=(0, 1, 1))
    assert plane.normal == pytest.approx((0, 1, 0))
    with pytest.raises(ValueError, match="needs its normal"):
        Plane.through((0, 0, 0), (0, 0, 2))
    with pytest.raises(ValueError, match="zero"):
        Plane.through((0, 0), (0, 0))


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_two_bonds_for_each_atom_of_a_close_packed_row(angle):
    sites = turned(hexagonal(((-10, 10), (-5, 5))), angle)
    plane = Plane.through((0, 0), (np.cos(angle), np.sin(angle)))
    above, below = bonds_across(plane, sites, SPACING)
    assert np.linalg.norm(sites[above] - sites[below], axis=1) == pytest.approx(SPACING)
    assert (plane.height(sites[above]) > 0).all()
    assert (plane.height(sites[below]) < 0).all()
    inside = np.abs(plane.position(sites[above])) < 8
    assert set(np.unique(above[inside], return_counts=True)[1]) == {2}


def test_no_bonds_beside_the_body():
    above, below = bonds_across(Plane.through((0, 50), (1, 0)), hexagonal(((0, 9), (0, 9))), 1.1)
    assert above.size == below.size == 0
