"""The body: groups, order, velocity gradient, history."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.body import Body, Placement
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.groups import ALL, OfLevel
from gimpmd_gimp.sweeps.threads import Team
from gimpmd_schemas.errors import BackendError

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)


def make_body(placement: Placement | None = None) -> Body:
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (16, 8), (False, True)))
    return Body(mesh, fill(mesh, 2, 1.0), LAW, placement or Placement(), Team(1))


def test_a_group_of_all_points_shares_their_order() -> None:
    body = make_body()
    assert body.stripes(OfLevel(0)) is body.stripes(ALL)


def test_groups_by_mask_follow_their_points_when_these_are_sorted_again() -> None:
    body = make_body()
    one = body.add_group(body.points.reference[:, 0] < 3.0)
    other = body.add_group(body.points.reference[:, 0] > 13.0)
    body.points.x[:] = body.points.x[::-1].copy()
    body.settle(body.points, 0.0)
    assert (body.mask(one) == (body.points.reference[:, 0] < 3.0)).all()
    assert (body.mask(other) == (body.points.reference[:, 0] > 13.0)).all()


def test_velocity_gradient_of_a_linear_field_is_exact() -> None:
    body = make_body()
    L = np.array([[1e-3, 2e-3], [-4e-3, 3e-3]])
    V = body.mesh.positions() @ L.T
    inside = (body.points.x[:, 1] > 1.0) & (body.points.x[:, 1] < 7.0)  # away from the period
    chosen = np.flatnonzero(inside)
    found = body.velocity_gradient(chosen, V)
    np.testing.assert_allclose(found, np.tile(L, (chosen.size, 1, 1)), atol=1e-15)


@pytest.mark.parametrize("configuration", ["current", "reference"])
def test_points_that_drift_ask_to_be_sorted_again(configuration) -> None:
    body = make_body(Placement(configuration))
    assert not body.refresh(0, 0.0)
    body.points.x[0, 1] += 0.3
    assert body.refresh(0, 0.0) == (configuration == "current")


def test_a_lost_point_is_named_with_the_time() -> None:
    body = make_body()
    lost = int(np.argmax(body.points.reference[:, 0]))
    body.points.x[lost, 0] += 10.0
    with pytest.raises(BackendError, match=r"from \(15\.75, .* left the background grid at t = 7"):
        body.refresh(0, 7.0)


def test_points_without_the_history_of_the_law_are_refused() -> None:
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (16, 8), (False, True)))
    points = fill(mesh, 2, 1.0, history=3)
    with pytest.raises(ValueError, match="0 history variables, but the points have 3"):
        Body(mesh, points, LAW, Placement(), Team(1))
