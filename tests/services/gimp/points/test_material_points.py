"""Material points: all fields stay together."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from gimpmd_gimp.points.material_points import MaterialPoints, join, points_at_rest, take


def some(count: int, d: int = 2, history: int = 0, first_id: int = 0) -> MaterialPoints:
    """Points with random reference positions."""
    reference = np.random.default_rng(count).uniform(0.0, 4.0, (count, d))
    volume, half = np.full(count, 0.25), np.full((count, d), 0.25)
    level = np.zeros(count, dtype=np.int32)
    return points_at_rest(reference, volume, 2.0, half, level, first_id, history)


def test_points_at_rest() -> None:
    points = some(5, d=3, history=4, first_id=7)
    assert (points.count, points.dim) == (5, 3)
    np.testing.assert_array_equal(points.id, np.arange(7, 12))
    np.testing.assert_array_equal(points.mass, 0.5)
    np.testing.assert_array_equal(points.x, points.reference)
    np.testing.assert_array_equal(points.F, np.tile(np.eye(3), (5, 1, 1)))
    assert points.history.shape == (5, 4)
    for name in ("v", "dv", "history", "block", "flags"):
        assert not getattr(points, name).any(), name
    assert some(5).history.shape == (5, 0)


def test_take_and_join_keep_the_rows_of_all_fields() -> None:
    points = some(6, history=2)
    points.history[:] = np.arange(12.0).reshape(6, 2)
    order = np.array([4, 0, 2])
    parts = [take(points, order), take(points, points.id % 2 == 1)]
    together = join(parts)
    np.testing.assert_array_equal(together.id, [4, 0, 2, 1, 3, 5])
    for field in fields(points):
        expected = getattr(points, field.name)[together.id]
        np.testing.assert_array_equal(getattr(together, field.name), expected)
    parts[0].history[:] = -1.0  # a copy
    assert points.history.min() == 0.0


def test_positions_on_the_grid() -> None:
    points = some(3)
    points.x += 1.0
    assert points.on_grid("current") is points.x
    assert points.on_grid("reference") is points.reference


def test_strain_in_voigt_order() -> None:
    for d, expected in ((1, [1]), (2, [1, 4, 5]), (3, [1, 5, 9, 14, 10, 6])):
        points = some(1, d=d)
        points.F += np.arange(1.0, d * d + 1.0).reshape(d, d)
        np.testing.assert_allclose(points.strain[0], expected)
