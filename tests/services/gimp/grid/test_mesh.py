"""Blocks, numbering and constraints of a mesh on one rank; patches."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh, cut
from gimpmd_gimp.points.distribution import fill, settle, sort


def nested(dim: int, periodic: bool) -> Hierarchy:
    return Hierarchy(
        (0.0,) * dim,
        1.0,
        (32,) * dim,
        (periodic,) * dim,
        ((((16, 48),) * dim,), (((44, 76),) * dim,)),
    )


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_points_fill_the_domain_once(dim):
    h = Hierarchy((0.0,) * dim, 1.0, (16,) * dim, (False,) * dim, ((((8, 24),) * dim,),))
    points = fill(Mesh(h), 2, 3.0)
    assert points.mass.sum() == pytest.approx(3.0 * 16.0**dim, rel=1e-14)
    assert np.unique(points.id).size == points.count
    inside = (np.abs(points.reference - 8.0) < 4.0).all(axis=1)
    assert (points.level == inside).all()


def test_find_names_basis_nodes_alone():
    mesh = Mesh(nested(2, False))
    found = mesh.find(2, np.array([[60, 60], [44, 60], [0, 0]]))
    assert found[0] >= 0
    assert mesh.basis[found[0]]
    assert (found[1:] == -1).all()
    assert mesh.coords[found[0]].tolist() == [60, 60]


@pytest.mark.parametrize(("ranks", "counts"), [(1, 1), (2, 2), (3, 3), (4, 4), (6, 6)])
def test_patches_tile_their_box(ranks, counts):
    patches = cut(((3, 27), (10, 40)), ranks)
    assert len(patches) == counts
    cells = np.zeros((40, 50), dtype=int)
    for (x0, x1), (y0, y1) in patches:
        cells[x0:x1, y0:y1] += 1
    assert (cells[3:27, 10:40] == 1).all()
    assert cells.sum() == 24 * 30


def test_a_small_box_has_fewer_patches_than_ranks():
    assert len(cut(((0, 4), (0, 4)), 64)) == 4


def test_sorted_points_of_a_stripe_share_no_node_with_the_next_but_one():
    mesh = Mesh(nested(2, True))
    points = settle(mesh, fill(mesh, 2, 1.0))
    home, stripe = sort(mesh, points)
    rows = np.floor(home[:, 0] + 0.5).astype(int) - 1 + 1000 * points.block
    for parity in (0, 1):
        mine = stripe % 2 == parity
        touched = {}
        for number in np.unique(stripe[mine]):
            base = rows[stripe == number]
            touched[number] = set(base) | set(base + 1) | set(base + 2)
        numbers = sorted(touched)
        for a, b in pairwise(numbers):
            assert not touched[a] & touched[b]
