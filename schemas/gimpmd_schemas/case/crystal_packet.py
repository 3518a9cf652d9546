"""Tilted packets in anisotropic bodies: sums of plane waves, each a mode of its own wave vector.

Off the axes of a crystal the motion of a mode is neither along its wave vector nor across it, and
changes with the direction of the wave vector. So do its speed and, more, its group velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Packet
from gimpmd_schemas.mechanics.elasticity import christoffel_of

WIDEST = 5.0
"""Wave vectors farther from the carrier, in standard deviations, are left out: 4e-6 of it."""

APART = 6.0
"""Distance from the body to the next repetition of the packet, in standard deviations."""


@dataclass(frozen=True)
class PlaneWaves:
    """The sum of ``moved cos(k . (x - center) - frequency t)`` over waves, at t = 0.

    Attributes
    ----------
    center : where all waves are in phase, shape ``(d,)``.
    k : wave vectors, shape ``(m, d)``.
    moved : amplitudes of the displacement, shape ``(m, d)``.
    frequency : angular frequencies, shape ``(m,)``.
    """

    center: Floats
    k: Floats
    moved: Floats
    frequency: Floats

    def state(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Displacement and velocity, shape ``(n, d)``, and the gradient of the first."""
        u, v = np.zeros_like(x), np.zeros_like(x)
        gradient = np.zeros((*x.shape, x.shape[1]))
        for k, moved, frequency in zip(self.k, self.moved, self.frequency, strict=True):
            phase = (x - self.center) @ k
            sine = np.sin(phase)
            u += np.cos(phase)[:, None] * moved
            v += (frequency * sine)[:, None] * moved
            gradient -= sine[:, None, None] * np.outer(moved, k)
        return u, v, gradient

    def velocity_gradient(self, x: Floats) -> Floats:
        """Gradient of the velocity, shape ``(n, d, d)``."""
        rate = np.zeros((*x.shape, x.shape[1]))
        for k, moved, frequency in zip(self.k, self.moved, self.frequency, strict=True):
            phase = (x - self.center) @ k
            rate += (frequency * np.cos(phase))[:, None, None] * np.outer(moved, k)
        return rate


def plane_waves(packet: Packet, squares: Floats, span: tuple[float, float]) -> PlaneWaves:
    """The waves of a tilted packet; their wave vectors differ along its axis only.

    Parameters
    ----------
    packet : Packet
        In the plane of its axis and the next one, which is a mirror plane of the material.
    squares : ndarray, shape ``(3, 3)`` or ``(6, 6)``
        Stiffness over density, in squared speeds.
    span : pair of float
        Ends of the body along the axis of the packet. The sum repeats beyond them.
    """
    dim = 2 if len(squares) == 3 else 3
    s = packet.cycles * packet.wavelength / 2.355  # from full width at half maximum to deviation
    reach = max(abs(end - packet.center) for end in span)
    step = 2.0 * math.pi / (reach + APART * s)
    most = math.ceil(WIDEST / (s * step))
    beside = step * np.arange(-most, most + 1)
    weights = np.exp(-((beside * s) ** 2) / 2.0)
    wave = 2.0 * math.pi / packet.wavelength
    k = np.tile(wave * np.array(packet.travel(dim)), (len(beside), 1))
    k[:, packet.axis] += beside
    frequency, moved = modes(packet, squares, k)
    amplitude = packet.strain / wave * weights / weights.sum()
    return PlaneWaves(
        center=packet.center * np.eye(dim)[packet.axis],
        k=k,
        moved=amplitude[:, None] * moved,
        frequency=frequency,
    )


def modes(packet: Packet, squares: Floats, k: Floats) -> tuple[Floats, Floats]:
    """Frequencies ``(m,)`` and unit vectors of motion ``(m, d)`` of a packet's mode at ``k``.

    Of the two modes that move in the plane ``P`` is the faster one. Its motion has a positive part
    along k, that of ``S`` along k turned by 90 degrees from the packet's axis to the next one.
    """
    dim = k.shape[1]
    plane = [packet.axis, (packet.axis + 1) % dim]
    tensors = christoffel_of(squares, k)[:, plane][:, :, plane]
    square, vectors = np.linalg.eigh(tensors)
    place = 1 if packet.polarization == "P" else 0
    moved = np.zeros_like(k)
    moved[:, plane] = vectors[:, :, place]
    along = k[:, plane] if place else k[:, plane[::-1]] * [-1.0, 1.0]
    moved *= np.where((moved[:, plane] * along).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    return np.sqrt(square[:, place]), moved
