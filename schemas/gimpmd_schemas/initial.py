"""Initial state of both sides: displacement and velocity at reference positions."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case import Case, Packet, VelocityField
from gimpmd_schemas.grid import Floats
from gimpmd_schemas.zones import in_box


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
    x : ndarray, shape ``(n, d)``
        Reference positions.

    Returns
    -------
    u, v : ndarray, shape ``(n, d)``
    gradient : ndarray, shape ``(n, d, d)``
        ``gradient[:, i, j] = du_i / dx_j``.
    """
    n, dim = x.shape
    u, v = np.zeros_like(x), np.zeros_like(x)
    gradient = np.zeros((n, dim, dim))
    for packet in case.initial.packets:
        component = packet.component(dim)
        shape, strain = packet_strain(packet, x[:, packet.axis])
        u[:, component] += shape
        v[:, component] -= packet.direction * case.packet_speed(packet) * strain
        gradient[:, component, packet.axis] += strain
    for field in case.initial.velocities:
        inside = np.ones(n, dtype=np.bool_) if field.box is None else in_box(field.box, x)
        v[inside] += velocity_at(field, x[inside])
    return u, v, gradient


def velocity_at(field: VelocityField, x: Floats) -> Floats:
    """Velocity of a field at positions ``x`` inside its box, shape ``(n, d)``."""
    velocity = np.tile(field.velocity, (x.shape[0], 1))
    if field.gradient is not None:
        arm = x - (0.0 if field.center is None else np.array(field.center))
        velocity += arm @ np.array(field.gradient).T
    return velocity
