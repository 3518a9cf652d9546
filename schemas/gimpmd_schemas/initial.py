"""Initial state of both sides: displacement and velocity at reference positions."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case import Case, Packet
from gimpmd_schemas.grid import Floats


def packet_strain(packet: Packet, x: Floats) -> tuple[Floats, Floats]:
    """Displacement and strain of a packet, both shape ``(n,)``, at positions ``x`` along it."""
    k = 2.0 * np.pi / packet.wavelength
    s = packet.cycles * packet.wavelength / 2.355  # standard deviation from the half-width
    xi = x - packet.center
    envelope = packet.strain / k * np.exp(-(xi**2) / (2.0 * s**2))
    return envelope * np.cos(k * xi), -envelope * (xi / s**2 * np.cos(k * xi) + k * np.sin(k * xi))


def initial_state(case: Case, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Displacement, velocity and displacement gradient at the start.

    Parameters
    ----------
    x : ndarray, shape ``(n, 2)``
        Reference positions.

    Returns
    -------
    u, v : ndarray, shape ``(n, 2)``
    gradient : ndarray, shape ``(n, 2, 2)``
        ``gradient[:, i, j] = du_i / dx_j``.
    """
    u, v = np.zeros_like(x), np.zeros_like(x)
    gradient = np.zeros((x.shape[0], 2, 2))
    for packet in case.initial.packets:
        component = packet.axis if packet.polarization == "P" else 1 - packet.axis
        shape, strain = packet_strain(packet, x[:, packet.axis])
        u[:, component] += shape
        v[:, component] -= packet.direction * case.wave_speed(packet.polarization) * strain
        gradient[:, component, packet.axis] += strain
    return u, v, gradient
