"""Initial state of both sides: displacement and velocity as functions of reference positions."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.crystal_packet import PlaneWaves, plane_waves
from gimpmd_schemas.case.form import Packet, VelocityField
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import in_box

STEP = 1e-4
"""Step of the central difference along a packet, in wavelengths."""


def packet_strain(packet: Packet, x: Floats) -> tuple[Floats, Floats]:
    """Displacement and strain, both shape ``(n,)``, of a packet along its axis.

    Parameters
    ----------
    packet : Packet
        Its wave vector lies along the axis.
    x : ndarray, shape ``(n,)``
        Coordinates along the axis.
    """
    k = 2.0 * np.pi / packet.wavelength
    s = packet.cycles * packet.wavelength / 2.355  # from full width at half maximum to deviation
    xi = x - packet.center
    envelope = packet.strain / k * np.exp(-(xi**2) / (2.0 * s**2))
    return envelope * np.cos(k * xi), -envelope * (xi / s**2 * np.cos(k * xi) + k * np.sin(k * xi))


def tilted_packet(packet: Packet, x: Floats) -> tuple[Floats, Floats]:
    """Displacement ``(n, d)`` and its gradient ``(n, d, d)`` of a packet with a tilted wave vector.

    The displacement of a P packet is the gradient of the plane wave times its envelope. The
    displacement of an S packet is that gradient rotated by 90 degrees. So neither contains a part
    of the other polarization.
    """
    dim = x.shape[1]
    k = 2.0 * np.pi / packet.wavelength
    s = packet.cycles * packet.wavelength / 2.355  # as in ``packet_strain``
    n, e = np.array(packet.travel(dim)), np.eye(dim)[packet.axis]
    xi = x[:, packet.axis] - packet.center
    envelope = packet.strain / k**2 * np.exp(-(xi**2) / (2.0 * s**2))
    slope, bend = -xi / s**2 * envelope, (xi**2 / s**4 - 1.0 / s**2) * envelope
    phase = k * (x @ n - packet.center * n[packet.axis])
    cosine, sine = np.cos(phase), np.sin(phase)
    u = (slope * cosine)[:, None] * e - k * (envelope * sine)[:, None] * n
    gradient = (bend * cosine)[:, None, None] * np.outer(e, e)
    gradient -= k * (slope * sine)[:, None, None] * (np.outer(e, n) + np.outer(n, e))
    gradient -= k**2 * (envelope * cosine)[:, None, None] * np.outer(n, n)
    if packet.polarization == "P":
        return u, gradient
    turn = np.zeros((dim, dim))
    turn[(packet.axis + 1) % dim, packet.axis], turn[packet.axis, (packet.axis + 1) % dim] = 1, -1
    return u @ turn.T, turn @ gradient


def initial_state(plan: Plan, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Displacement, velocity and displacement gradient at the start.

    Parameters
    ----------
    plan : Plan
        Gives the initial conditions and the wave speeds of the continuum.
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
    for packet in plan.initial.packets:
        wave, rate, slope = _state(plan, packet, x)
        u += wave
        v += rate
        gradient += slope
    stretch = plan.initial.stretch
    if stretch is not None:
        arm = x - (0.0 if stretch.center is None else np.array(stretch.center))
        u += arm @ np.array(stretch.gradient).T
        gradient += np.array(stretch.gradient)
    for field in plan.initial.velocities:
        inside = np.ones(n, dtype=np.bool_) if field.box is None else in_box(field.box, x)
        v[inside] += velocity_at(field, x[inside])
    return u, v, gradient


def velocity_gradient(plan: Plan, x: Floats) -> Floats:
    """Gradient of the velocity at the start, shape ``(n, d, d)``; see `initial_state`."""
    n, dim = x.shape
    rate = np.zeros((n, dim, dim))
    for packet in plan.initial.packets:
        if plan.has_crystal_modes(packet):
            rate += _plane_waves(plan, packet).velocity_gradient(x)
            continue
        step = STEP * packet.wavelength
        ahead = step * np.array(packet.travel(dim))
        change = _wave(packet, x + ahead)[1] - _wave(packet, x - ahead)[1]
        rate -= plan.packet_speed(packet) * change / (2.0 * step)
    for field in plan.initial.velocities:
        if field.gradient is not None:
            inside = np.ones(n, dtype=np.bool_) if field.box is None else in_box(field.box, x)
            rate[inside] += np.array(field.gradient)
    return rate


def _state(plan: Plan, packet: Packet, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Displacement and velocity ``(n, d)`` of any packet, and the gradient of the first."""
    if plan.has_crystal_modes(packet):
        return _plane_waves(plan, packet).state(x)
    u, gradient = _wave(packet, x)
    return u, -plan.packet_speed(packet) * gradient @ np.array(packet.travel(plan.dim)), gradient


def _plane_waves(plan: Plan, packet: Packet) -> PlaneWaves:
    """The modes of a tilted packet in an anisotropic body."""
    return plane_waves(packet, plan.squared_speeds(), plan.domain.box[packet.axis])


def _wave(packet: Packet, x: Floats) -> tuple[Floats, Floats]:
    """Displacement ``(n, d)`` and its gradient ``(n, d, d)`` of a packet of one speed."""
    if packet.tilt != 0.0:
        return tilted_packet(packet, x)
    dim, component = x.shape[1], packet.component(x.shape[1])
    u, gradient = np.zeros_like(x), np.zeros((len(x), dim, dim))
    u[:, component], gradient[:, component, packet.axis] = packet_strain(packet, x[:, packet.axis])
    return u, gradient


def velocity_at(field: VelocityField, x: Floats) -> Floats:
    """Velocity ``(n, d)`` of a field at positions ``x`` inside its box."""
    velocity = np.tile(field.velocity, (x.shape[0], 1))
    if field.gradient is not None:
        arm = x - (0.0 if field.center is None else np.array(field.center))
        velocity += arm @ np.array(field.gradient).T
    return velocity
