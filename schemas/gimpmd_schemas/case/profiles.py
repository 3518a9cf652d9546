"""Values on a face as functions of position.

The value of a face in the case file is a list of components, or one of the structs below. A new
profile is a struct with the methods of `Linear`, and a member of the union `Value`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.base import PerAxis, Strict, Vector
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.mechanics.crack_field import crack_displacement

Components = Annotated[tuple[float | None, ...], Meta(max_length=3)]
"""One component for each axis; None leaves a component free."""


class Linear(Strict, frozen=True, tag_field="profile", tag="linear"):
    """A value that changes linearly with position.

    Attributes
    ----------
    value : components at the centre; ``null`` leaves one free.
    gradient : matrix G of ``value + G (X - center)``, X being the position at rest.
    center : where the value is ``value``; null: the origin.
    """

    value: Components
    gradient: Annotated[tuple[Vector, ...], PerAxis]
    center: Vector | None = None

    def components(self) -> Components:
        """See `components`."""
        return self.value

    def at(self, x: Floats, stiffness: Floats) -> Floats:
        """Value ``(n, d)`` at positions ``(n, d)``; zero along free components."""
        given = np.array([value is not None for value in self.value])
        base = np.array([value or 0.0 for value in self.value])
        arm = x - (0.0 if self.center is None else np.array(self.center))
        return np.where(given, base + arm @ np.array(self.gradient).T, 0.0)

    def vectors(self) -> dict[str, tuple[object, ...] | None]:
        """Entries that have one component for each axis, by their keys."""
        rows = {f".gradient[{i}]": row for i, row in enumerate(self.gradient)}
        return {
            ".value": self.value,
            ".center": self.center,
            ".gradient": self.gradient,
            **rows,
        }

    def check(self, key: str, condition: str, rules: Rules) -> None:
        """Check that free components have no gradient."""
        for i, (value, row) in enumerate(zip(self.value, self.gradient, strict=False)):
            rules.require(
                value is not None or not any(row),
                f"{key}.gradient[{i}]",
                row,
                f"is the gradient of component {i + 1}, which value leaves free",
                "write zeros, or give the component a value",
            )


class KField(Strict, frozen=True, tag_field="profile", tag="k-field"):
    """Displacement around the tip of a crack, by the stress intensity factors.

    It lies in the plane of x and y, and needs an isotropic material.

    Attributes
    ----------
    k1, k2 : stress intensity factors of the modes I and II (pressure times square root of length).
    tip : position of the crack tip, ``[x, y]``.
    angle : direction in which the crack would grow, from the x axis (degrees).
    """

    tip: tuple[float, float]
    k1: float = 0.0
    k2: float = 0.0
    angle: float = 0.0

    def components(self) -> Components:
        """See `components`."""
        return (1.0, 1.0)

    def at(self, x: Floats, stiffness: Floats) -> Floats:
        """Displacement ``(n, d)`` at positions ``(n, d)``."""
        u = np.zeros_like(x)
        lame, shear = stiffness[0, 1], stiffness[-1, -1]
        turn = math.radians(self.angle)
        arm = x[:, :2] - np.array(self.tip)
        u[:, :2] = crack_displacement(arm, self.k1, self.k2, lame, shear, turn)
        return u

    def vectors(self) -> dict[str, tuple[object, ...] | None]:
        """Entries that have one component for each axis: none."""
        return {}

    def check(self, key: str, condition: str, rules: Rules) -> None:
        """Check that the profile is a displacement, and that it is not zero."""
        rules.require(
            condition == "displacement",
            f"{key}.profile",
            "k-field",
            "is a displacement",
            "set condition: displacement, with a ramp",
        )
        rules.require(
            self.k1 != 0.0 or self.k2 != 0.0,
            f"{key}.k1",
            self.k1,
            "is zero, and so is k2",
            "give at least one stress intensity factor",
        )


Value = Components | Linear | KField


def components(value: Value) -> Components:
    """Which components a value prescribes: those that are not None."""
    return value if isinstance(value, tuple) else value.components()


def value_at(value: Value, x: Floats, stiffness: Floats) -> Floats:
    """Value of a face at positions.

    Parameters
    ----------
    value : Value
    x : ndarray, shape ``(n, d)``
        Positions at rest.
    stiffness : ndarray, shape ``(m, m)``
        Stiffness of the continuum in Voigt order (pressure).

    Returns
    -------
    ndarray, shape ``(n, d)``
        Zero along components that are free.
    """
    if isinstance(value, tuple):
        whole = np.zeros_like(x)
        whole[:, : len(value)] = [entry or 0.0 for entry in value]
        return whole
    return value.at(x, stiffness)
