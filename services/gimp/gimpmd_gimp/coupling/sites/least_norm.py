"""The solution of least norm of a system with dependent equations.

LSQR [1]_ in the inner product of ``K^-1``, K the normal matrix ``A A^T`` with a small shift,
factored once. It needs two or three steps where LSQR by itself takes thousands, and tolerates
equations that follow from others.

.. [1] C. C. Paige, M. A. Saunders, ACM Trans. Math. Softw. 8, 43 (1982).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.multifrontal import Multifrontal
from gimpmd_schemas.arrays import Floats

SHIFT = 1e-10
"""Added to the diagonal of K after it is scaled to 1: it is singular by rigid motions and more."""

STEPS = 40
"""Steps at most."""

FLAT = 6
"""Steps without progress after which the equations count as inconsistent."""

GROWTH = 2.0
"""Growth of the norm in one step that shows that the rest of the right side cannot be balanced, as
it is that of round-off or of finite differences. Without an end there the solution blows up."""

EXACT = 1e-14
"""Rest, over the right side, at which the iteration stops."""


Solve = Callable[[Floats], Floats]


def factor(K: Sparse, x: Floats) -> Solve:
    """Factor a symmetric positive semidefinite matrix; returns the function that solves with it.

    Parameters
    ----------
    K : sparse matrix, shape ``(n k, n k)``
        Rows ``p k`` to ``p k + k - 1`` belong to place p.
    x : ndarray, shape ``(n, d)``
        Places.
    """
    diagonal: Floats = K.diagonal()
    scale = 1.0 / np.sqrt(np.maximum(diagonal, np.finfo(float).tiny))
    data = np.repeat(scale, np.diff(K.indptr)) * K.data
    data *= scale[K.indices]
    shifted = sparse.csr_array((data, K.indices, K.indptr), shape=K.shape)
    shifted.setdiag(shifted.diagonal() + SHIFT)
    if x.shape[1] == 3:
        fronts = Multifrontal(shifted, x)
        return lambda b: scale * fronts.solve(scale * b)
    lu = superlu(shifted)
    return lambda b: np.asarray(scale * lu.solve(scale * b))


def superlu(A: Sparse) -> SuperLU:
    """Factor a symmetric positive definite matrix by SuperLU, in an order of least degree."""
    return splu(
        A.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def least_norm(
    forward: Callable[[Floats], Floats],
    backward: Callable[[Floats], Floats],
    solve: Solve,
    b: Floats,
) -> tuple[Floats, Floats]:
    """Solve ``A x = b`` for the x of least norm.

    Parameters
    ----------
    forward, backward : callable
        Products with A and with its transpose.
    solve : callable
        Solves with K; see `factor`.
    b : ndarray, shape ``(n,)``

    Returns
    -------
    x : ndarray
    rest : ndarray, shape ``(n,)``
        ``b - A x``. If it is not small, the equations contradict each other.
    """
    best, rest = np.zeros_like(backward(b)), b
    size = float(np.abs(b).max(initial=0.0))
    if size == 0.0:
        return best, rest
    raw = b
    u = solve(raw)
    beta = _root(raw, u)
    raw, u = raw / beta, u / beta
    v = backward(u)
    alpha = float(np.linalg.norm(v))
    v /= alpha
    w, x = v.copy(), np.zeros_like(v)
    phi_bar, rho_bar = beta, alpha
    flat, last = 0, 0.0
    for _ in range(STEPS):
        raw = forward(v) - alpha * raw
        u = solve(raw)
        beta = _root(raw, u)
        if beta > 0.0:
            raw, u = raw / beta, u / beta
            v = backward(u) - beta * v
            alpha = float(np.linalg.norm(v))
            v = v / alpha if alpha > 0.0 else v
        rho = float(np.hypot(rho_bar, beta))
        c, s = rho_bar / rho, beta / rho
        theta, rho_bar, phi, phi_bar = s * alpha, -c * alpha, c * phi_bar, s * phi_bar
        x = x + (phi / rho) * w
        w = v - (theta / rho) * w
        now = b - forward(x)
        norm = float(np.linalg.norm(x))
        if last > 0.0 and norm > GROWTH * last:
            break
        flat = 0 if np.abs(now).max() < 0.5 * np.abs(rest).max() else flat + 1
        if np.abs(now).max() < np.abs(rest).max():
            best, rest = x, now
        if np.abs(rest).max() <= EXACT * size or flat == FLAT or beta == 0.0:
            break
        last = norm
    return best, rest


def _root(raw: Floats, u: Floats) -> float:
    """Norm in the inner product of ``K^-1``; round-off may make its square negative."""
    return max(float(raw @ u), 0.0) ** 0.5
