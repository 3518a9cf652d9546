"""The background grid: numbering, periodic images, folding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.grid.background import PAD, BackgroundGrid

grids = st.builds(
    BackgroundGrid,
    origin=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    cell=st.floats(0.1, 10),
    cells=st.tuples(st.integers(1, 7), st.integers(1, 7)),
    periodic=st.tuples(st.booleans(), st.booleans()),
)


def indices(grid: BackgroundGrid, ids: np.ndarray) -> np.ndarray:
    """Indices ``(i, j)`` of node ids, by the rule of the docstring."""
    return np.stack(np.divmod(ids, grid.shape[1]), axis=1) - PAD


@given(grids)
def test_ids_and_positions_correspond(grid: BackgroundGrid) -> None:
    x = grid.positions()
    assert x.shape == (grid.size, 2)
    ij = indices(grid, np.arange(grid.size))
    assert ij.min(axis=0).tolist() == [-PAD, -PAD]
    assert ij.max(axis=0).tolist() == [n + PAD for n in grid.cells]
    # nearest node of every position is the node itself
    back = np.rint((x - grid.origin) / grid.cell).astype(int)
    assert (back == ij).all()


@given(grids)
def test_images_stand_a_period_apart(grid: BackgroundGrid) -> None:
    ids, images = np.arange(grid.size), grid.images()
    offset = indices(grid, ids) - indices(grid, images)
    for axis in range(2):
        if grid.periodic[axis]:
            assert (offset[:, axis] % grid.cells[axis] == 0).all()
        else:
            assert (offset[:, axis] == 0).all()
    canonical = grid.canonical()
    assert canonical[images].all()
    assert (images[canonical] == ids[canonical]).all()
    expected = [n if p else n + 1 + 2 * PAD for n, p in zip(grid.cells, grid.periodic, strict=True)]
    assert canonical.sum() == expected[0] * expected[1]


@pytest.mark.parametrize("shape", [(), (2,), (2, 2)])
@given(grid=grids, seed=st.integers(0, 2**32 - 1))
def test_fold_adds_images_and_copies_sums_back(
    shape: tuple[int, ...], grid: BackgroundGrid, seed: int
) -> None:
    before = np.random.default_rng(seed).integers(-9, 10, (*grid.shape, *shape)).astype(float)
    field = before.copy()
    grid.fold(field)
    flat, images = field.reshape(grid.size, *shape), grid.images()
    sums = np.zeros_like(flat)
    np.add.at(sums, images, before.reshape(flat.shape))
    assert (flat == sums[images]).all()  # small whole numbers: sums are exact
    assert flat[grid.canonical()].sum() == before.sum()


def test_fold_reaches_two_cells_from_both_sides() -> None:
    """With two cells a node has images on both sides, and an image repeats a node twice over."""
    grid = BackgroundGrid((0.0, 0.0), 1.0, (2, 1), (True, False))
    field = np.zeros(grid.shape)
    field[:, 0] = [1, 2, 4, 8, 16, 32, 64]  # i = -2 ... 4
    grid.fold(field)
    assert field[PAD, 0] == 1 + 4 + 16 + 64
    assert field[PAD + 1, 0] == 2 + 8 + 32
    assert field[:, 0].tolist() == [85, 42, 85, 42, 85, 42, 85]
