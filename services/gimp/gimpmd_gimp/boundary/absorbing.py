"""Absorbing faces: viscous dashpots (Lysmer and Kuhlemeyer, J. Eng. Mech. Div. 95 (1969) 859).

A face is held by the traction ``-z . v`` with the impedances ``z = rho c`` of plane waves that
travel along the face's normal, one for each component of the velocity. Such waves go out without
a reflection; waves at an angle are reflected in part, and a static load is not carried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.boundary.conditions import Load, Traction, make_loads
from gimpmd_gimp.fracture.cracks import Cracks
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import Law
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.points.material_points import Configuration, MaterialPoints
from gimpmd_gimp.sweeps.kernels import sweep
from gimpmd_schemas.arrays import Floats, Ints

SMALL = 1e-6
"""Strain by which a law is probed."""


@dataclass(frozen=True)
class Absorbing:
    """A face of the domain that lets waves out.

    Attributes
    ----------
    axis, side : the face; side 0 is the lower one.
    """

    axis: int
    side: int


def impedance(law: Law, axis: int, dim: int) -> tuple[float, ...]:
    """``rho c`` of plane waves along an axis, for each direction of motion.

    From the law's response to the displacement gradients ``e_i n`` at ``F = I``; exact where the
    axes are axes of symmetry of the material.
    """
    F = np.tile(np.eye(dim), (2 * dim, 1, 1))
    for i in range(dim):
        F[2 * i, i, axis] += SMALL
        F[2 * i + 1, i, axis] -= SMALL
    stress = np.zeros_like(F)
    at_rest = np.zeros((2 * dim, history_size(law)))
    law.stress(np.arange(2 * dim), 0, 2 * dim, F, at_rest, stress)
    slope = [
        (stress[2 * i, i, axis] - stress[2 * i + 1, i, axis]) / (2.0 * SMALL) for i in range(dim)
    ]
    return tuple(float(np.sqrt(law.density * max(modulus, 0.0))) for modulus in slope)


def make_dashpots(
    absorbing: Sequence[Absorbing],
    law: Law,
    mesh: Mesh,
    points: MaterialPoints,
    cracks: Cracks | None = None,
    configuration: Configuration = "current",
) -> list[Load]:
    """Loads whose nodal force is the face's dashpot constant at each node."""
    faces = [
        Traction(one.axis, one.side, impedance(law, one.axis, points.dim), lambda _: 1.0)
        for one in absorbing
    ]
    return make_loads(faces, mesh, points, cracks, configuration)


@sweep
def absorb(
    nodes: Ints, C: Floats, M: Floats, floor: float, V: Floats, U: Floats, J_loads: Floats
) -> None:
    """Let dashpots act in a kick: ``M U = J - C (V + U / 2)``, stable for any C.

    Parameters
    ----------
    C : ndarray, shape ``(size, d)``
        Dashpot constants times the span of the kick.
    U : ndarray, shape ``(size, d)``
        ``J / M`` on entry.
    J_loads : ndarray, shape ``(size, d)``
        Takes the impulse of the dashpots too.
    """
    for n in range(nodes.size):
        i = nodes[n]
        if M[i] <= floor:
            continue
        for d in range(C.shape[1]):
            if C[i, d] > 0.0:
                U[i, d] = (M[i] * U[i, d] - C[i, d] * V[i, d]) / (M[i] + 0.5 * C[i, d])
                J_loads[i, d] -= C[i, d] * (V[i, d] + 0.5 * U[i, d])
