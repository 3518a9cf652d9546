"""Factors of a matrix whose rows belong to places."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from gimpmd_gimp.coupling.sites.multifrontal import Multifrontal, dissect, memory


def neighbours(x: np.ndarray) -> sparse.csr_array:
    """Which places of a grid are at most a cell apart along each axis."""
    return sparse.csr_array(np.abs(x[:, None] - x).max(axis=2) <= 1.0)


def grid(shape: tuple[int, ...]) -> np.ndarray:
    """Places of a grid with cells of unit size."""
    axes = np.meshgrid(*[np.arange(n) for n in shape], indexing="ij")
    return np.stack(axes, axis=-1).reshape(-1, len(shape)).astype(float)


@pytest.mark.parametrize("shape", [(5, 4, 30), (7, 8, 6), (40, 30), (3, 3, 2)])
def test_it_solves_as_scipy_does(shape: tuple[int, ...]) -> None:
    """Three unknowns at each node of a grid, bound to those of neighbouring nodes."""
    rng = np.random.default_rng(6)
    x = grid(shape)
    x = x[rng.permutation(len(x))]
    near = neighbours(x)
    B = sparse.kron(near, np.ones((3, 3)), format="csr")
    B.data = rng.normal(size=B.nnz)
    A = sparse.csr_array(B @ sparse.diags_array(np.ones(B.shape[1])) @ B.T)
    A = A.multiply(sparse.kron(near, np.ones((3, 3)))).tocsr()
    A = (A + sparse.diags_array(1.0 + abs(A).sum(axis=1))).tocsr()
    b = rng.normal(size=A.shape[0])
    np.testing.assert_allclose(Multifrontal(A, x).solve(b), spsolve(A.tocsc(), b), atol=1e-12)


def test_memory_is_that_of_all_arrays() -> None:
    """The most that arrays take while the factors are made, and what stays."""
    x, k = grid((9, 8, 7)), 6
    near = neighbours(x)
    A = sparse.csr_array(sparse.kron(near, np.full((k, k), -1.0)))
    A.setdiag(28.0 * k)
    held, most = memory(dissect(near, x), k)
    tracemalloc.start()
    factors = Multifrontal(A, x)
    stays, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert factors.solve(np.ones(A.shape[0])) == pytest.approx(
        spsolve(A.tocsc(), np.ones(A.shape[0]))
    )
    assert stays == pytest.approx(held, rel=0.05)
    assert peak == pytest.approx(most, rel=0.05)
