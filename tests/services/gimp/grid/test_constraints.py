"""Constrained nodes: linear fields and sums are exact, and the two directions are transposes."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.constraints import Constraints, make_constraints
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh

TRIPLES = np.array([(7, 1, 0.5), (3, 0, 0.25), (7, 2, 0.5), (3, 4, 0.5), (3, 1, 0.25)])


def nested(dim: int, periodic: bool) -> Mesh:
    finer = ((((16, 48),) * dim,), (((44, 76),) * dim,))
    return Mesh(Hierarchy((0.0,) * dim, 1.0, (32,) * dim, (periodic,) * dim, finer))


def few() -> Constraints:
    node, parent, weight = TRIPLES.T
    return make_constraints(node.astype(np.int64), parent.astype(np.int64), weight)


def test_rows_from_triples_in_any_order() -> None:
    made = few()
    assert made.node.tolist() == [3, 7]
    assert made.start.tolist() == [0, 3, 5]
    assert made.parent.tolist() == [0, 4, 1, 1, 2]
    assert made.weight.tolist() == [0.25, 0.5, 0.25, 0.5, 0.5]


def test_a_constrained_node_takes_the_mean_and_gives_its_sum() -> None:
    field = np.arange(16.0).reshape(8, 2) ** 2
    mean = 0.25 * field[0] + 0.5 * field[4] + 0.25 * field[1]
    prolonged = field.copy()
    few().prolong(prolonged)
    np.testing.assert_array_equal(prolonged[3], mean)
    np.testing.assert_array_equal(np.delete(prolonged, [3, 7], 0), np.delete(field, [3, 7], 0))
    restricted = field.copy()
    few().restrict(restricted)
    np.testing.assert_array_equal(restricted[[3, 7]], 0.0)
    np.testing.assert_array_equal(restricted[1], field[1] + 0.25 * field[3] + 0.5 * field[7])
    np.testing.assert_array_equal(restricted.sum(axis=0), field.sum(axis=0))


def test_those_of_chosen_nodes() -> None:
    chosen = np.zeros(8, dtype=np.bool_)
    chosen[[0, 7]] = True
    some = few().among(chosen)
    assert (some.node.tolist(), some.start.tolist()) == ([7], [0, 2])
    assert (some.parent.tolist(), some.weight.tolist()) == ([1, 2], [0.5, 0.5])
    none = few().among(np.zeros(8, dtype=np.bool_))
    field = np.arange(8.0)[:, None]
    before = field.copy()
    none.restrict(field)
    none.prolong(field)
    np.testing.assert_array_equal(field, before)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_hanging_nodes_reproduce_linear_fields(dim) -> None:
    """And sums that they give away keep their total and their first moment."""
    mesh = nested(dim, periodic=False)
    x, hanging = mesh.positions(), mesh.constraints.node
    slope = np.random.default_rng(dim).normal(size=(dim, 2))
    field = 3.0 + x @ slope
    exact = field[hanging].copy()
    field[hanging] = np.nan
    mesh.constraints.prolong(field)
    np.testing.assert_allclose(field[hanging], exact, rtol=1e-13)

    used = mesh.basis.copy()
    used[hanging] = True
    sums = np.random.default_rng(1).normal(size=(mesh.size, 2)) * used[:, None]
    total, moment = sums.sum(axis=0), x.T @ sums
    mesh.constraints.restrict(sums)
    np.testing.assert_array_equal(sums[hanging], 0.0)
    np.testing.assert_allclose(sums.sum(axis=0), total, atol=1e-11)
    np.testing.assert_allclose(x.T @ sums, moment, atol=1e-9)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("dim", [1, 2])
def test_constrained_nodes_and_basis_share_no_node_and_transpose(dim, periodic):
    mesh = nested(dim, periodic)
    constraints = mesh.constraints
    assert not mesh.basis[constraints.node].any()
    assert mesh.basis[constraints.parent].all()
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(mesh.size, 1)), rng.normal(size=(mesh.size, 1))
    used = mesh.basis.copy()
    used[constraints.node] = True
    a[~used] = b[~used] = 0.0
    prolonged, restricted = a.copy(), b.copy()
    constraints.prolong(prolonged)
    constraints.restrict(restricted)
    assert float((prolonged * b).sum()) == pytest.approx(float((a * restricted)[mesh.basis].sum()))
