"""Equations near faces of the body of which those need not hold whose strains load the face."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.sites.shells import Face
from gimpmd_gimp.coupling.sites.spared import Spared, near_faces

STRESS = np.array([[[3.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 3.0]], [[0.0, 1.0], [1.0, 0.0]]])
"""Of unit strains of a plate with C11 = 3, C12 = C44 = 1."""

PLACES = np.array([[0.0, 9.0], [2.0, 9.0], [4.0, 9.0], [2.0, 2.0]])
"""On the left face, a cell away, two cells away, and near two faces."""

FACES = [Face(0, 0.0), Face(1, 0.0)]


def test_strains_with_a_traction_are_spared_near_a_face() -> None:
    turn, spare = near_faces(PLACES, FACES, STRESS, 2.0)
    np.testing.assert_allclose((turn @ turn.T).toarray(), np.eye(4 * 2 * 3), atol=1e-14)
    rows = spare.reshape(4, 2, 3)
    assert (rows.sum(axis=2) == np.array([2, 2, 0, 3])[:, None]).all()
    directions = turn.toarray()[:3, :3]
    traction = directions @ STRESS[:, :, 0]
    np.testing.assert_allclose(traction[~rows[0, 0]], 0.0, atol=1e-14)
    np.testing.assert_allclose(np.abs(directions[~rows[0, 0]]), np.array([[1, 3, 0]]) / 10**0.5)


class Plain:
    """Equations with a dense matrix."""

    def __init__(self, A: np.ndarray) -> None:
        self.A = A

    def forward(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(self.A @ x)

    def backward(self, u: np.ndarray) -> np.ndarray:
        return np.asarray(self.A.T @ u)

    def normal(self) -> sparse.csr_array:
        return sparse.csr_array(self.A @ self.A.T)


def test_products_belong_to_one_matrix() -> None:
    A = np.random.default_rng(4).normal(size=(4 * 2 * 3, 7))
    turn, spare = near_faces(PLACES, FACES, STRESS, 2.0)
    spared = Spared(Plain(A), turn, spare, 0.7)
    whole = np.column_stack([spared.forward(e) for e in np.eye(7 + spare.sum())])
    np.testing.assert_allclose(whole[:, :7], turn @ A, atol=1e-14)
    np.testing.assert_allclose(whole[spare, 7:], 0.7 * np.eye(spare.sum()), atol=1e-14)
    np.testing.assert_allclose(whole[~spare, 7:], 0.0)
    back = np.column_stack([spared.backward(e) for e in np.eye(len(A))])
    np.testing.assert_allclose(back, whole.T, atol=1e-14)
    np.testing.assert_allclose(spared.normal().toarray(), whole @ whole.T, atol=1e-12)
