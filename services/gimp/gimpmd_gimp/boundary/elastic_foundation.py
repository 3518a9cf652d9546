"""An elastic foundation (Winkler): springs that hold a face of the domain."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers, Kick
from gimpmd_gimp.boundary.face import outermost_points
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import Units


class ElasticFoundation(Condition):
    """The traction ``-k u`` on a face of the domain, u being the displacement of the face.

    The springs of the outermost points have the energy ``E = k / 2 sum_p A_p |u_p(face)|^2``. The
    displacement of a point continues to its outer face with its own gradient,
    ``u_p(face) = u_p + (F_p - I) s_p``, where ``s_p`` leads from the point to the face. The nodal
    force is the derivative of this energy,
    ``f_i = -k sum_p A_p u_p(face) (S_ip + s_p . grad S_ip)``, so energy is balanced as precisely as
    for any elastic body: E is minus the external work of the foundation.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    stiffness : float
        k: pressure per displacement (mechanical units), the same along all axes.
    region : Box, optional
        The part of the face, see `FacePart.region`. None: all of the face.
    """

    external: ClassVar[bool] = True

    def __init__(self, axis: int, side: int, stiffness: float, region: Box | None = None) -> None:
        self._axis, self._side, self._stiffness = axis, side, stiffness
        self._region = region

    def regroup(self) -> None:
        """See ``Condition``."""
        self._chosen = outermost_points(self.body, self._axis, self._side, self._region)
        p = self.body.points
        edge = (self.body.hierarchy.cell / 2.0**p.level)[:, None]
        size = (2.0 * p.half * edge)[self._chosen]
        self._to_face = np.zeros((self._chosen.size, p.dim))
        self._to_face[:, self._axis] = (0.5 if self._side else -0.5) * size[:, self._axis]
        self._area = np.prod(np.delete(size, self._axis, axis=1), axis=1)

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        p, s = self.body.points, self.body.stencils
        rows = np.flatnonzero(p.level[self._chosen] == level)
        chosen, to_face = self._chosen[rows], self._to_face[rows]
        u = self._displacement(chosen, to_face)
        lead = kick.time - self.clock.time  # positions are those of the beginning of the step
        if lead:
            moved = np.zeros_like(p.v)
            kernels.gather_vector(chosen, 0, chosen.size, s, self.nodes.V, lead, moved)
            u += moved[chosen]
        pull = -self._stiffness * self._area[rows][:, None] * u
        if self.body.law.finite and not self.body.total_lagrangian:
            to_face = np.einsum("nij,nj->ni", p.F[chosen], to_face)
        # sum_p pull (S_ip + s . grad S_ip): a momentum of unit mass, less a stress s (x) pull
        unit, q, stress = np.ones(p.count), np.zeros_like(p.v), np.zeros_like(p.F)
        q[chosen] = pull
        stress[chosen] = np.einsum("ni,nj->nij", to_face, pull)
        span, loads = float(kick.span[level]), self.nodes.loads
        kernels.scatter_vector(chosen, 0, chosen.size, s, unit, span * q, loads)
        kernels.scatter_force(chosen, 0, chosen.size, s, -span, unit, stress, loads)

    def energy(self) -> float:
        """Elastic energy of the springs of this rank's points now."""
        u = self._displacement(self._chosen, self._to_face)
        return 0.5 * self._stiffness * float(self._area @ (u**2).sum(axis=1))

    def _displacement(self, chosen: Ints, to_face: Floats) -> Floats:
        """Displacement of the outer faces of some points, shape ``(len(chosen), d)``."""
        p = self.body.points
        H = p.F[chosen] - np.eye(p.dim)
        return p.x[chosen] - p.reference[chosen] + np.einsum("nij,nj->ni", H, to_face)


def from_face(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``foundation`` of a case file."""
    stiffness = units.stress_to_mechanical(part.condition.stiffness or 0.0)
    return [ElasticFoundation(part.axis, part.side, stiffness, part.region)]


FACE_CONDITIONS: ConditionMakers = {"foundation": from_face}
