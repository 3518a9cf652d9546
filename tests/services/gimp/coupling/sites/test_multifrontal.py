"""Factors of a matrix whose rows belong to places."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from gimpmd_gimp.coupling.sites.multifrontal import Multifrontal


@pytest.mark.parametrize("shape", [(5, 4, 30), (7, 8, 6), (40, 30), (3, 3, 2)])
def test_it_solves_as_scipy_does(shape: tuple[int, ...]) -> None:
    """Three unknowns at each node of a grid, bound to those of neighbouring nodes."""
    rng = np.random.default_rng(6)
    axes = np.meshgrid(*[np.arange(n) for n in shape], indexing="ij")
    x = np.stack(axes, axis=-1).reshape(-1, len(shape)).astype(float)
    x = x[rng.permutation(len(x))]
    near = np.abs(x[:, None] - x).max(axis=2) <= 1.0
    B = sparse.kron(sparse.csr_array(near), np.ones((3, 3)), format="csr")
    B.data = rng.normal(size=B.nnz)
    A = sparse.csr_array(B @ sparse.diags_array(np.ones(B.shape[1])) @ B.T)
    A = A.multiply(sparse.kron(near, np.ones((3, 3)))).tocsr()
    A = (A + sparse.diags_array(1.0 + abs(A).sum(axis=1))).tocsr()
    b = rng.normal(size=A.shape[0])
    np.testing.assert_allclose(Multifrontal(A, x).solve(b), spsolve(A.tocsc(), b), atol=1e-12)
