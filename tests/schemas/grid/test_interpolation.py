"""Interpolation along one axis: the integrals of the paper, and the properties they imply."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad

from gimpmd_schemas.grid.interpolation import hat, stencil

positions = st.floats(-50.0, 50.0)
half_widths = st.floats(1e-3, 0.5)


def weights(x: float, l: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    base, *values = stencil(x, l)
    return base + np.arange(3), np.array(values[:3]), np.array(values[3:])


def tent(x: float) -> float:
    """Paper Eq. 11 in cells."""
    return max(0.0, 1.0 - abs(x))


def averaged_hat(x: float, l: float, node: int) -> float:  # noqa: E741
    """Paper Eqs. 13 and 14 by numerical integration, split at the kinks."""
    kinks = [k for k in (node - 1.0, float(node), node + 1.0) if x - l < k < x + l]
    value, _ = quad(lambda y: tent(y - node), x - l, x + l, points=kinks or None, epsabs=1e-13)
    return value / (2.0 * l)


@given(positions, half_widths)
def test_partition_of_unity(x: float, l: float) -> None:  # noqa: E741
    _, s, g = weights(x, l)
    assert (s >= 0.0).all()
    assert s.sum() == pytest.approx(1.0, abs=1e-14)
    assert g.sum() == pytest.approx(0.0, abs=1e-14)


@given(positions, half_widths)
def test_linear_field_is_reproduced_exactly(x: float, l: float) -> None:  # noqa: E741
    nodes, s, g = weights(x, l)
    # round-off: cancellation against nodes up to 50, divided by l in the gradient
    assert (s * nodes).sum() == pytest.approx(x, abs=1e-12)
    assert (g * (nodes - nodes[1])).sum() == pytest.approx(1.0, abs=1e-13 / l)


@given(positions, half_widths)
@example(0.5, 0.5)
@example(0.0, 0.5)
@example(-0.5, 0.25)
def test_equals_the_integral_of_the_paper(x: float, l: float) -> None:  # noqa: E741
    nodes, s, _ = weights(x, l)
    for node, weight in zip(nodes, s, strict=True):
        assert weight == pytest.approx(averaged_hat(x, l, int(node)), abs=1e-11)
    # no node beyond the three is touched
    for node in (nodes[0] - 1, nodes[2] + 1):
        assert averaged_hat(x, l, int(node)) == pytest.approx(0.0, abs=1e-12)


@given(positions, half_widths)
def test_gradient_is_the_derivative_of_the_weights(x: float, l: float) -> None:  # noqa: E741
    # the weights are piecewise quadratic with second derivative at most 1 / (2 l) (times two at
    # the middle node), so a central difference is off by no more than that times its step
    eps = 1e-6
    nodes, _, g = weights(x, l)
    for node, gradient in zip(nodes, g, strict=True):
        sides = [dict(zip(*weights(x + e, l)[:2], strict=True)).get(node, 0.0) for e in (eps, -eps)]
        assert (sides[0] - sides[1]) / (2 * eps) == pytest.approx(gradient, abs=2 * eps / l + 1e-8)


@given(st.integers(-20, 20), half_widths)
def test_weights_and_gradients_are_continuous(cell: int, l: float) -> None:  # noqa: E741
    """C1 at every place where the branches meet: nodes, mid-cells, particle edges on nodes."""
    eps = 1e-9
    for x in (cell, cell + 0.5, cell + l, cell - l):
        below, above = ({}, {})
        for side, e in ((below, -eps), (above, eps)):
            nodes, s, g = weights(x + e, l)
            side.update({n: (a, b) for n, a, b in zip(nodes, s, g, strict=True)})
        for node in set(below) | set(above):
            (s0, g0), (s1, g1) = below.get(node, (0.0, 0.0)), above.get(node, (0.0, 0.0))
            assert s1 == pytest.approx(s0, abs=4 * eps)
            assert g1 == pytest.approx(g0, abs=4 * eps / l + 1e-12)


@given(positions)
def test_small_particles_see_the_hat_function(x: float) -> None:
    l = 1e-9  # noqa: E741
    nodes, s, _ = weights(x, l)
    assert s == pytest.approx([tent(x - node) for node in nodes], abs=2 * l + 1e-13)


@given(positions)
@example(-3.0)
@example(2.5)
def test_hat_weights_are_those_of_the_two_nearest_nodes(x: float) -> None:
    base, *s = hat(x)
    assert base <= x < base + 1 or s[1] == 1.0  # rounding may reach the next node
    assert s == pytest.approx([tent(x - base), tent(x - base - 1)], abs=1e-13)
    assert sum(s) == 1.0
