"""Points that the planes cut fill the continuum exactly, each once."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.cutting import cut
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints, join, take
from gimpmd_schemas.grid.planes import Interface
from tests.services.gimp.coupling.interface.crystal_bodies import INF

H, CELLS = 2.0, 12
REGION = ((0.0, 24.0), (0.0, 24.0))


def whole(per_cell: int = 2) -> MaterialPoints:
    return fill(Mesh(Hierarchy((0.0, 0.0), H, (CELLS, CELLS), (False, False))), per_cell, 3.0)


def covered(points: MaterialPoints, x: np.ndarray) -> np.ndarray:
    """How many points' domains each place lies in."""
    inside = np.abs(x[:, None] - points.reference) < H * points.half
    return inside.all(axis=2).sum(axis=1)


@pytest.mark.parametrize("per_cell", [1, 2, 3])
@pytest.mark.parametrize(
    "planes",
    [
        ((7.3, 17.9), (5.2, 18.6)),
        ((-INF, 17.9), (5.2, INF)),
        ((-INF, 8.0 + 1e-12), (-INF, INF)),  # on a node line but for rounding
        ((8.2, 8.7), (9.1, 9.6)),  # within one point: it becomes a frame
    ],
)
def test_points_tile_the_continuum_and_nothing_else(planes, per_cell):
    interface = Interface(planes, REGION)
    points = cut(whole(per_cell), interface, H)
    x = np.random.default_rng(0).uniform(0.0, 24.0, (4000, 2))
    np.testing.assert_array_equal(covered(points, x), ~interface.free(x))
    (left, right), (bottom, top) = (np.clip(p, 0.0, 24.0) for p in planes)
    rest = 24.0**2 - (right - left) * (top - bottom)
    assert points.volume.sum() == pytest.approx(rest, rel=1e-11)
    np.testing.assert_allclose(points.volume, (2.0 * H * points.half).prod(axis=1), rtol=1e-12)
    np.testing.assert_allclose(points.mass, 3.0 * points.volume, rtol=1e-12)
    np.testing.assert_allclose(points.x, points.reference, atol=1e-12)
    assert points.half.min() > 1e-10
    assert np.unique(points.id).size == points.count
    # no point reaches across a node line
    low, high = (points.reference + s * H * points.half for s in (-1.0, 1.0))
    assert (np.floor(low / H + 1e-9) == np.ceil(high / H - 1e-9) - 1).all()


def test_a_corner_leaves_two_points_and_ids_do_not_hang_on_who_cuts():
    interface = Interface(((7.3, 17.9), (5.2, 18.6)), REGION)
    before = whole()
    points = cut(before, interface, H)
    corner = (np.abs(before.reference - (7.3, 5.2)) < H * before.half).all(axis=1)
    around = np.abs(points.reference - before.reference[corner]) < 0.5 * H / 2
    assert around.all(axis=1).sum() == 2
    shares = [
        take(before, before.reference[:, 0] < 9.0),
        take(before, before.reference[:, 0] > 9.0),
    ]
    again = join([cut(share, interface, H) for share in shares])
    ours, theirs = np.argsort(points.id), np.argsort(again.id)
    for name in ("id", "reference", "half", "mass"):
        mine, other = getattr(points, name)[ours], getattr(again, name)[theirs]
        np.testing.assert_array_equal(mine, other)


def test_pieces_of_a_strained_point_lie_where_its_field_puts_them():
    points = whole()
    G = np.array([[0.01, 0.02], [-0.03, 0.04]])
    points.F += G
    points.x += points.reference @ G.T
    pieces = cut(points, Interface(((7.3, 17.9), (5.2, 18.6)), REGION), H)
    np.testing.assert_allclose(pieces.x, pieces.reference @ (np.eye(2) + G).T, atol=1e-12)
