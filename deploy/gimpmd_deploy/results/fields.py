"""Scalar fields of atoms and material points by name: those that a run holds, and derived ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from gimpmd_deploy.results.particles import Particles, voigt_names
from gimpmd_deploy.results.temperature import local_temperature
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS

Kind = Literal["signed", "positive", "any"]

NOT_SHOWN = ("id", "mass", "zone", "displacement_gradient", "strain_energy")
"""Columns that are no fields of figures: what a particle is, and what others follow from."""


@dataclass(frozen=True)
class Field:
    """How a scalar field is written and coloured.

    Attributes
    ----------
    symbol : name or symbol in a label, with mathtext.
    quantity : what it is measured in: ``pressure``, ``velocity`` and so on; empty for numbers.
    kind : ``signed`` if zero is the middle of its scale, ``positive`` if it is the lower end.
    """

    symbol: str
    quantity: str
    kind: Kind


KNOWN = {
    "pressure": Field("pressure", "pressure", "signed"),
    "von_mises": Field("von Mises stress", "pressure", "positive"),
    "speed": Field("speed", "velocity", "positive"),
    "temperature": Field("temperature", "temperature", "positive"),
    "potential_energy": Field("potential energy of an atom", "energy", "any"),
    "energy_density": Field("energy density", "energy_density", "positive"),
    "level": Field("level", "", "any"),
    "type": Field("type of atom", "", "any"),
    "equivalent_plastic_strain": Field("equivalent plastic strain", "", "positive"),
}

VECTORS = {"velocity": ("v", "velocity"), "displacement": ("u", "length")}
TENSORS = {
    "sigma": (r"\sigma", "pressure"),
    "strain": (r"\varepsilon", ""),
    "plastic_strain": (r"\varepsilon^p", ""),
}


def describe(name: str) -> Field:
    """Return how a field is written, from its name."""
    if name in KNOWN:
        return KNOWN[name]
    base, _, components = name.rpartition("_")
    symbol, quantity = (VECTORS | TENSORS).get(base, ("", ""))
    if not symbol:
        return Field(name.replace("_", " "), "", "any")
    if "strain" in base and components[0] != components[1:]:
        symbol = symbol.replace(r"\varepsilon", r"\gamma")  # shear strains are engineering strains
    return Field(f"${_with_index(symbol, components)}$", quantity, "signed")


def _with_index(symbol: str, components: str) -> str:
    return f"{symbol}_{{{components}}}"


def field_names(particles: Particles, units: str) -> list[str]:
    """Return the names of all scalar fields of these particles."""
    return list(_makers(particles, units))


def field_values(particles: Particles, name: str, units: str) -> Floats | None:
    """Return a field of these particles, shape ``(n,)``, in the units of the case.

    Parameters
    ----------
    particles : Particles
        All particles of a side: the temperature is an average over neighbours.
    name : str
        One of `field_names`.
    units : str
        Unit style of the case.

    Returns
    -------
    ndarray or None
        None if these particles have no such field.
    """
    make = _makers(particles, units).get(name)
    return None if make is None else np.asarray(make(), dtype=np.float64)


def von_mises(stress: Floats) -> Floats:
    """Von Mises stress of stresses in Voigt order, shape ``(n, 3)`` or ``(n, 6)``.

    In two dimensions the stress out of the plane counts as zero, as it is for atoms in a plane.
    """
    if stress.shape[1] == 3:
        xx, yy, xy = stress.T
        return np.asarray(np.sqrt(xx**2 - xx * yy + yy**2 + 3.0 * xy**2))
    xx, yy, zz, yz, xz, xy = stress.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2)))


def _makers(p: Particles, units: str) -> dict[str, Callable[[], Floats]]:
    """What makes each field of these particles, by name."""
    found: dict[str, Callable[[], Floats]] = {}
    pairs, axes, dim = voigt_names(p.dim), "xyz"[: p.dim], p.dim
    found |= {f"sigma_{pair}": partial(_column, p.stress, k) for k, pair in enumerate(pairs)}
    found["pressure"] = lambda: -p.stress[:, :dim].mean(axis=1)
    found["von_mises"] = lambda: von_mises(p.stress)
    for name in VECTORS:
        vector = getattr(p, name)
        found |= {f"{name}_{axis}": partial(_column, vector, k) for k, axis in enumerate(axes)}
    found["speed"] = lambda: np.linalg.norm(p.velocity, axis=1)
    for name, values in p.fields.items():
        if name in NOT_SHOWN:
            continue
        if values.ndim == 1:
            found[name] = partial(_column, values[:, None], 0)
        else:
            # plastic strain has the component zz in two dimensions too
            parts = pairs if values.shape[1] == len(pairs) else ["xx", "yy", "zz", "xy"]
            found |= {f"{name}_{ij}": partial(_column, values, k) for k, ij in enumerate(parts)}
    if "strain_energy" in p.fields:  # of points, in pressure units
        found["energy_density"] = lambda: p.fields["strain_energy"] / UNITS[units].nktv2p
    if {"mass", "type"} <= p.fields.keys():
        found["temperature"] = lambda: local_temperature(p, units)
    return found


def _column(values: Floats, index: int) -> Floats:
    return values[:, index]
