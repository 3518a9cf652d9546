"""Displacement around the tip of a straight crack in an isotropic body (Williams 1957)."""

from __future__ import annotations

import math

import numpy as np

from gimpmd_schemas.arrays import Floats


def crack_displacement(
    arm: Floats, k1: float, k2: float, lame: float, shear: float, angle: float = 0.0
) -> Floats:
    """Leading term of the displacement around a crack tip, in modes I and II.

    With the distance r from the tip and the angle t from the direction of growth,

        u_1 = q [K_I cos(t/2) (kappa - cos t) + K_II sin(t/2) (kappa + 2 + cos t)]
        u_2 = q [K_I sin(t/2) (kappa - cos t) - K_II cos(t/2) (kappa - 2 + cos t)]

    with ``q = sqrt(r / 2 pi) / (2 mu)``
    and ``kappa = (lambda + 3 mu) / (lambda + mu)``. This is 3 - 4 nu in plane strain. In plane
    stress and in two-dimensional bodies, lambda is the constant of the plane.

    Parameters
    ----------
    arm : ndarray, shape ``(n, 2)``
        Positions relative to the tip. Positions on the crack belong to its upper face.
    k1, k2 : float
        Stress intensity factors (pressure times square root of length).
    lame, shear : float
        Lame constants of the plane (pressure).
    angle : float
        Direction of growth, from the x axis (radians).

    Returns
    -------
    ndarray, shape ``(n, 2)``

    References
    ----------
    M. L. Williams, J. Appl. Mech. 24 (1957) 109; T. L. Anderson, Fracture Mechanics, table 2.2.
    """
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    local = arm @ turn.T
    r, t = np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0])
    kappa = (lame + 3.0 * shear) / (lame + shear)
    c, s, cos = np.cos(0.5 * t), np.sin(0.5 * t), np.cos(t)
    scale = np.sqrt(r / (2.0 * np.pi)) / (2.0 * shear)
    ahead = k1 * c * (kappa - cos) + k2 * s * (kappa + 2.0 + cos)
    across = k1 * s * (kappa - cos) - k2 * c * (kappa - 2.0 + cos)
    return np.stack([scale * ahead, scale * across], axis=1) @ turn
