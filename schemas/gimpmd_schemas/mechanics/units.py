"""LAMMPS unit styles, and conversion to the mechanical units of the continuum.

The continuum uses mass, length and time of the unit style, so that ``F = m a`` holds without a
factor. Energies and pressures of the style are converted with the constants of LAMMPS:
``mvv2e`` (mass velocity^2 to energy), ``nktv2p`` (energy per volume to pressure) and ``boltz``
(temperature to energy).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """A LAMMPS unit style: conversion constants, and names of units."""

    style: str
    mvv2e: float
    nktv2p: float
    boltz: float
    mass: str
    length: str
    time: str
    energy: str
    pressure: str

    def stress_to_mechanical(self, pressure: float) -> float:
        """Convert a pressure of the style to mass / (length^(d-2) time^2)."""
        return pressure / (self.nktv2p * self.mvv2e)

    def stress_from_mechanical(self, stress: float) -> float:
        """Convert a mechanical stress to a pressure of the style."""
        return stress * self.nktv2p * self.mvv2e

    def energy_from_mechanical(self, energy: float) -> float:
        """Convert mass length^2 / time^2 to an energy of the style."""
        return energy * self.mvv2e

    def energy_to_mechanical(self, energy: float) -> float:
        """Convert an energy of the style to mass length^2 / time^2."""
        return energy / self.mvv2e

    def force_to_mechanical(self, force: float) -> float:
        """Convert a force of the style (energy / length) to mass length / time^2."""
        return force / self.mvv2e


UNITS = {
    "lj": Units("lj", 1.0, 1.0, 1.0, "m", "sigma", "tau", "epsilon", "epsilon/sigma^d"),
    "metal": Units(
        "metal", 1.0364269e-4, 1.6021765e6, 8.617343e-5, "g/mol", "A", "ps", "eV", "bar"
    ),
    "real": Units(
        "real", 48.88821291**2, 68568.415, 0.0019872067, "g/mol", "A", "fs", "kcal/mol", "atm"
    ),
    "si": Units("si", 1.0, 1.0, 1.3806504e-23, "kg", "m", "s", "J", "Pa"),
}
