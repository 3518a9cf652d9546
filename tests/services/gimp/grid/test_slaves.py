"""Parents of nodes that follow others."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.grid.slaves import Slaves, redirected

SLAVES = Slaves(
    node=np.array([[4, 0], [3, 2]]),
    start=np.array([0, 2, 5]),
    master=np.array([[5, 0], [6, 0], [2, 2], [1, 2], [2, 1]]),
    weight=np.array([2.0, -1.0, 1.5, -1.0, 0.5]),
)


def test_slaves_are_replaced_by_what_they_follow() -> None:
    row, level = np.array([0, 1, 2, 2]), np.array([1, 1, 1, 0])
    coords = np.array([[4, 0], [0, 0], [3, 2], [3, 2]])
    found = redirected(SLAVES, 1, row, level, coords, np.array([1.0, 1.0, 0.5, 0.5]))
    row, level, coords, weight = found
    np.testing.assert_array_equal(row, [0, 0, 1, 2, 2, 2, 2])
    np.testing.assert_array_equal(level, [1, 1, 1, 0, 1, 1, 1])
    np.testing.assert_array_equal(coords, [[5, 0], [6, 0], [0, 0], [3, 2], [2, 2], [1, 2], [2, 1]])
    np.testing.assert_array_equal(weight, [2.0, -1.0, 1.0, 0.5, 0.75, -0.5, 0.25])


def test_images_of_slaves_follow_too() -> None:
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (8, 4), (False, True)), slaves=SLAVES)
    rows = mesh.find(0, SLAVES.node)
    assert (rows >= 0).all()
    assert not mesh.basis[rows].any()
    np.testing.assert_array_equal(mesh.counts[rows], 1.0)
    field = np.random.default_rng(0).normal(size=(mesh.size, 1))
    mesh.constraints.prolong(field)
    for slave, (a, b) in zip(SLAVES.node, ((0, 2), (2, 5)), strict=True):
        wanted = SLAVES.weight[a:b] @ field[mesh.find(0, SLAVES.master[a:b])]
        images = (mesh.coords[:, 0] == slave[0]) & (mesh.coords[:, 1] % 4 == slave[1])
        assert images.sum() > 1
        np.testing.assert_allclose(field[images], wanted[0])
    total = field.sum()
    mesh.constraints.restrict(field)
    assert field.sum() != total  # weights of images are added to those of the nodes
    np.testing.assert_array_equal(field[rows], 0.0)
