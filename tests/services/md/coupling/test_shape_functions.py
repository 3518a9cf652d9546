"""Linear hat functions: node lines, periods, and nodes that are not there."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.coupling.shape_functions import Hats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((1.0, -2.0), 2.0, (6, 5), (False, True))
NODES = np.flatnonzero(GRID.canonical())


def test_linear_fields_are_exact_and_sums_are_whole() -> None:
    x = np.random.default_rng(0).uniform([1.0, -2.0], [13.0, 6.0], (500, 2))  # off the period's end
    hats = Hats(GRID, NODES).stencils(x)
    gradient = np.array([[0.3, -0.2], [0.1, 0.4]])
    field = GRID.positions()[NODES] @ gradient.T
    np.testing.assert_allclose(hats.interpolate(field), x @ gradient.T, atol=1e-13)
    values = np.random.default_rng(1).normal(size=x.shape)
    sums = hats.gather(values, NODES.size)
    np.testing.assert_allclose(sums.sum(axis=0), values.sum(axis=0), atol=1e-12)
    # the transpose of interpolation
    assert (sums * field).sum() == pytest.approx((values * (x @ gradient.T)).sum(), rel=1e-12)


def test_a_period_ends_where_it_begins() -> None:
    field = np.random.default_rng(2).normal(size=(NODES.size, 2))
    hats = Hats(GRID, NODES)
    low, high = (hats.stencils(np.array([[4.3, y]])).interpolate(field) for y in (-2.0, 8.0))
    np.testing.assert_array_equal(low, high)
    between = hats.stencils(np.array([[5.0, 7.0]])).interpolate(field)[0]
    ends = [
        np.flatnonzero((GRID.positions()[NODES] == [5.0, y]).all(axis=1))[0] for y in (6.0, -2.0)
    ]
    np.testing.assert_allclose(between, field[ends].mean(axis=0), atol=1e-15)


@pytest.mark.parametrize("off", [0.0, 1e-6, -1e-6])
def test_an_atom_on_a_node_line_wants_no_node_beyond(off: float) -> None:
    """Lattice positions are known to round-off; the region may end on a line of nodes."""
    x = GRID.positions()
    half = np.flatnonzero(GRID.canonical() & (x[:, 0] > 4.0))
    hats = Hats(GRID, half).stencils(np.array([[5.0 + off, 1.0]]))
    constant = hats.interpolate(np.ones((half.size, 2)))
    np.testing.assert_allclose(constant, 1.0, atol=1e-15)


def test_a_node_that_is_not_there_is_an_error() -> None:
    half = np.flatnonzero(GRID.canonical() & (GRID.positions()[:, 0] > 4.0))
    with pytest.raises(
        BackendError, match=r"\(4.9, 1\) is on a rank whose patch lies too far away"
    ):
        Hats(GRID, half).stencils(np.array([[6.0, 1.0], [4.9, 1.0]]))
