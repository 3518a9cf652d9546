"""Absorbing faces: viscous dashpots (Lysmer and Kuhlemeyer, J. Eng. Mech. Div. 95 (1969) 859).

The traction ``-z . v`` acts on an absorbing face. The impedances ``z = rho c`` are those of plane
waves that travel along the normal of the face, one for each component of the velocity. Such waves
leave without reflection. Waves at an angle are reflected in part, and a static load is not carried.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers, Kick
from gimpmd_gimp.boundary.face import FaceLoad, find_face_loads
from gimpmd_gimp.laws import Law
from gimpmd_gimp.laws.law import history_size
from gimpmd_schemas.arrays import Bools
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import Units

PROBE_STRAIN = 1e-6
"""Strain at which the stiffness of a law is measured."""


class Absorbing(Condition):
    """A face of the domain that lets waves leave.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    region : Box, optional
        The part of the face, see `FacePart.region`. None: all of the face.
    """

    external: ClassVar[bool] = True
    viscous: ClassVar[bool] = True
    needs_velocity: ClassVar[bool] = True

    def __init__(self, axis: int, side: int, region: Box | None = None) -> None:
        self._axis, self._side, self._region = axis, side, region
        self._dashpots: list[FaceLoad] = []

    def regroup(self) -> None:
        """See ``Condition``."""
        z = impedance(self.body.law, self._axis, self.body.points.dim)
        self._dashpots = find_face_loads(self.body, self._axis, self._side, z, self._region)

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        for dashpot in self._dashpots:
            if dashpot.level == level:
                dashpot.add(kick.span[level], self.nodes.dashpot)

    def leave_out(self, linked: Bools) -> None:
        """Nodes with a dashpot; see ``Condition``."""
        coefficient = np.zeros_like(self.nodes.V)
        for dashpot in self._dashpots:
            dashpot.add(1.0, coefficient)
        self.nodes.complete(0, coefficient)
        linked &= ~coefficient.any(axis=1)


def impedance(law: Law, axis: int, dim: int) -> tuple[float, ...]:
    """``rho c`` of plane waves along an axis, for each direction of motion.

    From the stress of the law at the displacement gradients ``e_i n`` about ``F = I``; exact where
    the axes are axes of symmetry of the material.
    """
    F = np.tile(np.eye(dim), (2 * dim, 1, 1))
    for i in range(dim):
        F[2 * i, i, axis] += PROBE_STRAIN
        F[2 * i + 1, i, axis] -= PROBE_STRAIN
    stress = np.zeros_like(F)
    at_rest = np.zeros((2 * dim, history_size(law)))
    law.stress(np.arange(2 * dim), 0, 2 * dim, F, at_rest, stress)
    slope = [
        (stress[2 * i, i, axis] - stress[2 * i + 1, i, axis]) / (2.0 * PROBE_STRAIN)
        for i in range(dim)
    ]
    return tuple(float(np.sqrt(law.density * max(modulus, 0.0))) for modulus in slope)


def from_face(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``absorbing`` of a case file."""
    return [Absorbing(part.axis, part.side, part.region)]


FACE_CONDITIONS: ConditionMakers = {"absorbing": from_face}
