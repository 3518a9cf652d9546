"""Interpolation functions along one axis (paper Eqs. 9 to 14).

The weight of a node in two or three dimensions is the product of its weights along the axes; see
``particle_grid``.
"""

from __future__ import annotations

import math

from gimpmd_schemas.compiled import njit


@njit(inline="always")
def stencil(x: float, l: float) -> tuple[int, float, float, float, float, float, float]:  # noqa: E741
    """Evaluate the generalized interpolation function: the hat function averaged over a particle.

    A particle that spans ``[x - l, x + l]`` overlaps the hat functions of three nodes, as long as
    its half-width ``l`` is at most half a cell.

    Parameters
    ----------
    x : float
        Position in cells (node ``n`` lies at ``x = n``).
    l : float
        Half-width of the particle in cells, ``0 < l <= 0.5``. For ``l -> 0`` the weights tend to
        those of ``hat``.

    Returns
    -------
    base : int
        Index of the first of three consecutive nodes.
    s0, s1, s2 : float
        Weights (paper Eq. 14 along one axis); their sum is one.
    g0, g1, g2 : float
        Derivatives of the weights with respect to ``x``, per cell; their sum is zero.
    """
    centre = math.floor(x + 0.5)
    r = x - centre
    left = min(max(l - r, 0.0), 2.0 * l)  # width of the particle to the left of the centre node
    right = 2.0 * l - left
    inverse = 0.5 / l
    g0 = -left * inverse
    g2 = right * inverse
    s0 = max(-r - l, 0.0) - 0.5 * left * g0
    s2 = max(r - l, 0.0) + 0.5 * right * g2
    return int(centre) - 1, s0, 1.0 - s0 - s2, s2, g0, -g0 - g2, g2


@njit(inline="always")
def hat(x: float) -> tuple[int, float, float]:
    """Evaluate the linear hat functions at a position ``x`` in cells (paper Eq. 11).

    Returns
    -------
    base : int
        Index of the node at or below ``x``.
    s0, s1 : float
        Weights of this node and of the next one; their sum is one.
    """
    low = math.floor(x)
    s1 = x - low
    return int(low), 1.0 - s1, s1
