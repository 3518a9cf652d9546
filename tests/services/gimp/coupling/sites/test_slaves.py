"""Nodes at the planes that follow others."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.shells import Shells, body_of
from gimpmd_gimp.coupling.sites.slaves import LEAST_SHARE, constraints, find_slaves, share_of
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid

EVERYWHERE = ((-np.inf, np.inf),) * 3
GRID = BackgroundGrid((0.0, 0.0), 1.0, (10, 10), (False, False))


def id_of(i: int, j: int) -> int:
    x = GRID.positions()
    return int(np.flatnonzero((x == [i, j]).all(axis=1))[0])


@pytest.mark.parametrize("f", [0.1, 0.5, 0.7])
def test_share_at_a_face_an_edge_and_a_reentrant_corner(f: float) -> None:
    """Of the node at 0, with the plane at 1 - f: the part of the hat beyond it is f^2 / 2."""
    far, face = 9.0, 0.5 * f**2
    plane = 1.0 - f
    slab = ((-far, plane), (-far, far))
    assert share_of(np.zeros(2), [slab], 1.0, EVERYWHERE[:2]) == pytest.approx(face)
    corner = ((-far, plane), (-far, 0.3))  # of two faces the one with more continuum counts
    share = share_of(np.zeros(2), [corner], 1.0, EVERYWHERE[:2])
    assert share == pytest.approx(max(face, 0.5 * 0.7**2))
    reentrant = [((-far, plane), (-far, far)), ((-far, far), (-far, 0.3))]
    share = share_of(np.zeros(2), reentrant, 1.0, EVERYWHERE[:2])
    assert share == pytest.approx(min(face, 0.5 * 0.7**2))
    in_space = ((-far, plane), (-far, far), (-far, far))
    assert share_of(np.zeros(3), [in_space], 1.0, EVERYWHERE) == pytest.approx(face)


def test_a_slave_of_a_face_extrapolates() -> None:
    shells = Shells((((2.5, 6.6), (3.4, 7.3)),), (((1.5, 7.6), (2.4, 8.3)),))
    found = find_slaves(GRID, shells, np.ones(GRID.size, dtype=bool))
    x = GRID.positions()
    assert set(map(tuple, x[found].astype(int).tolist())) >= {(3, 5), (6, 5), (5, 4), (5, 7)}
    outside = (np.abs(x - [4.55, 5.35]) > [2.05 - 1.0 + 1e-9, 1.95 - 1.0 + 1e-9]).any(axis=1)
    T = constraints(GRID, found, outside)
    row = T[[id_of(3, 5)]].toarray().ravel()
    assert row[id_of(2, 5)] == pytest.approx(2.0)
    assert row[id_of(1, 5)] == pytest.approx(-1.0)
    np.testing.assert_allclose(T @ x, x, atol=1e-12)  # linear fields are kept
    np.testing.assert_allclose(T.sum(axis=1), 1.0)
    assert not T[:, found].toarray().any()
    assert pytest.approx(LEAST_SHARE, rel=1e-3) == 0.5 * 0.735**2


def test_share_at_a_face_of_the_body() -> None:
    """Half of a hat on the face, none of one beyond; the plane at 1 - f cuts the other axis."""
    slab = [((-9.0, 9.0), (-9.0, 0.4))]
    body = ((0.0, np.inf), (-np.inf, np.inf))
    assert share_of(np.zeros(2), [((5.0, 6.0), (-9.0, 9.0))], 1.0, body) == pytest.approx(0.5)
    assert share_of(np.zeros(2), slab, 1.0, body) == pytest.approx(0.5 * 0.6**2)
    assert share_of(np.array([-1.0, 0.0]), slab, 1.0, body) == 0.0


def test_nodes_beyond_a_face_of_the_body_extrapolate() -> None:
    shells = Shells((((-np.inf, 6.6), (3.4, 7.3)),), (((-np.inf, 7.6), (2.4, 8.3)),))
    assert body_of(GRID) == ((0.0, 10.0), (0.0, 10.0))
    x = GRID.positions()
    touched = (np.abs(x[:, 0]) <= 1.0) & (x[:, 1] > 0.0) & (x[:, 1] < 10.0)
    found = find_slaves(GRID, shells, touched)
    beyond = np.flatnonzero(touched & (x[:, 0] < 0.0))
    assert set(beyond.tolist()) < set(found.tolist())
    in_body = (x[:, 0] >= 0.0) & (x[:, 1] >= 0.0) & (x[:, 1] <= 10.0)
    covered = in_body & ((x[:, 0] > 5.6) | (x[:, 1] < 4.4) | (x[:, 1] > 6.3))
    T = constraints(GRID, found, covered)
    np.testing.assert_allclose((T @ x)[touched], x[touched], atol=1e-12)
    row = T[[id_of(-1, 2)]].toarray().ravel()
    assert row[id_of(0, 2)] == pytest.approx(2.0)
    assert row[id_of(1, 2)] == pytest.approx(-1.0)
    assert not T[:, found].toarray().any()


def test_a_gap_that_is_too_narrow_is_refused() -> None:
    with pytest.raises(BackendError, match=r"node at \(5, 5\) .* gap between two regions"):
        constraints(GRID, np.array([id_of(5, 5)]), np.zeros(GRID.size, dtype=bool))
