"""The background grid: numbering of nodes and periodic images."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.grid.background import PAD, BackgroundGrid


def grids_of(dim: int) -> st.SearchStrategy[BackgroundGrid]:
    return st.builds(
        BackgroundGrid,
        origin=st.tuples(*[st.floats(-100, 100)] * dim),
        cell=st.floats(0.1, 10),
        cells=st.tuples(*[st.integers(1, 7 if dim == 2 else 4)] * dim),
        periodic=st.tuples(*[st.booleans()] * dim),
    )


grids = st.sampled_from([2, 3]).flatmap(grids_of)


def indices(grid: BackgroundGrid) -> np.ndarray:
    """Indices ``(i, j, k)`` of all nodes in the order of their ids."""
    return np.array(list(np.ndindex(grid.shape))) - PAD


@given(grids)
def test_ids_and_positions_correspond(grid: BackgroundGrid) -> None:
    x, index = grid.positions(), indices(grid)
    assert x.shape == (grid.size, grid.dim)
    assert index.max(axis=0).tolist() == [n + PAD for n in grid.cells]
    # the node nearest to each position is the node itself
    assert (np.rint((x - grid.origin) / grid.cell).astype(int) == index).all()


@given(grids)
def test_images_stand_a_period_apart(grid: BackgroundGrid) -> None:
    ids, images = np.arange(grid.size), grid.images()
    offset = indices(grid) - indices(grid)[images]
    for axis in range(grid.dim):
        if grid.periodic[axis]:
            assert (offset[:, axis] % grid.cells[axis] == 0).all()
        else:
            assert (offset[:, axis] == 0).all()
    canonical = grid.canonical()
    assert canonical.shape == (grid.size,)
    assert canonical[images].all()
    assert (images[canonical] == ids[canonical]).all()
    expected = [n if p else n + 1 + 2 * PAD for n, p in zip(grid.cells, grid.periodic, strict=True)]
    assert canonical.sum() == np.prod(expected)


def test_a_small_block_node_by_node() -> None:
    grid = BackgroundGrid((0.0, 10.0, -1.0), 0.5, (1, 2, 1), (False, True, False))
    assert grid.shape == (6, 7, 6)
    assert grid.size == 252
    node = ((1 + PAD) * 7 + (2 + PAD)) * 6 + (0 + PAD)  # indices (1, 2, 0)
    assert grid.positions()[node].tolist() == [0.5, 11.0, -1.0]
    assert grid.images()[node] == node - 2 * 6  # the same as (1, 0, 0), one period below
    assert not grid.canonical()[node]
