"""Solutions of least norm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from gimpmd_gimp.coupling.sites.least_norm import factor, least_norm


def dependent(rows: int, columns: int) -> np.ndarray:
    """A matrix whose last three rows are sums of others."""
    A = np.random.default_rng(4).normal(size=(rows, columns))
    A[-3:] = A[:3] + A[3:6]
    return A


def solve(A: np.ndarray, b: np.ndarray, dim: int = 2) -> tuple[np.ndarray, np.ndarray]:
    K = sparse.csr_array(A @ A.T)
    places = np.random.default_rng(6).uniform(size=(len(A), dim))
    return least_norm(lambda x: A @ x, lambda u: A.T @ u, factor(K, places), b)


@pytest.mark.parametrize("dim", [2, 3])
def test_it_is_that_of_the_pseudoinverse(dim: int) -> None:
    A = dependent(20, 35)
    b = A @ np.random.default_rng(5).normal(size=35)
    x, rest = solve(A, b, dim)
    np.testing.assert_allclose(x, np.linalg.pinv(A) @ b, atol=1e-11)
    assert np.abs(rest).max() < 1e-11 * np.abs(b).max()


def test_equations_that_contradict_each_other_leave_a_rest() -> None:
    A = dependent(20, 35)
    b = A @ np.ones(35)
    b[-1] += 1.0
    x, rest = solve(A, b)
    np.testing.assert_allclose(rest, b - A @ x)
    assert 0.1 < np.abs(rest).max() < 1.0
    assert np.isfinite(x).all()


@pytest.mark.parametrize("noise", [1e-13, 1e-10, 1e-7])
def test_noise_that_nothing_balances_does_not_blow_the_solution_up(noise: float) -> None:
    A = dependent(60, 90)
    b = A @ np.random.default_rng(5).normal(size=90)
    expected = np.linalg.pinv(A) @ b
    x, rest = solve(A, b + noise * np.random.default_rng(9).normal(size=60))
    assert np.linalg.norm(x - expected) < 1e-4 * np.linalg.norm(expected)
    assert np.abs(rest).max() < 10.0 * noise + 1e-12 * np.abs(b).max()


def test_nothing_is_asked_for_nothing() -> None:
    x, rest = solve(dependent(8, 12), np.zeros(8))
    assert not x.any()
    assert not rest.any()
