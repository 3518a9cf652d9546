"""Energy release rate and stress intensities at a crack tip, by domain integrals over the points.

The weight q falls smoothly from 1 around the tip to 0 at a radius; the material points are the
quadrature. With the displacement gradient H, first Piola-Kirchhoff stress P, strain energy W and
kinetic energy T per volume (Moran and Shih, Eng. Fract. Mech. 27 (1987) 615; Guo and Nairn,
CMES 6 (2004) 295)::

    J_k = int [P_ij H_ik - (W + T) delta_jk] q,j + rho (a_i H_ik - v_i L_ik) q dV

for growth along the crack (k = 1), whose faces carry no traction. The interaction integral with the
fields of a crack tip of unit K (Yau, Wang and Corten, J. Appl. Mech. 47 (1980) 335) gives the ratio
of the modes. J_1 gives their size, since J_1 does not depend on where the tip lies between two
nodes. J_2 follows from both. For other laws J_2 would need an integral over the faces, which does
not converge with points that stand beside the faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.laws.law import is_inelastic
from gimpmd_gimp.points.body import Body
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.energy_momentum import domain_integral

PLATEAU = 0.3
"""Share of the radius within which q is one, so that points next to the tip do not contribute."""


@dataclass(frozen=True)
class CrackTip:
    """Driving forces of a crack tip, in mechanical units.

    Attributes
    ----------
    J1 : float
        Energy release rate for growth straight on (energy per area; per length in two dimensions).
    J2 : float or None
        ``-2 K_I K_II / E'`` with E' of plane strain, for the isotropic linear law.
    K : tuple of float or None
        K_I and K_II (stress times the root of length) for the isotropic linear law.
    """

    J1: float
    J2: float | None
    K: tuple[float, float] | None


def crack_tip(
    body: Body,
    V: Floats,
    span: Floats,
    tip: Floats,
    direction: Floats,
    radius: float,
    normal: Floats | None = None,
    front: float = 1.0,
) -> CrackTip:
    """Energy release rate and stress intensities at a tip now; collective.

    Parameters
    ----------
    body : Body
    V : ndarray, shape ``(size, d)``
        Nodal velocity.
    span : ndarray, shape ``(top + 1,)``
        Length of the last kick of each level.
    tip : ndarray, shape ``(d,)``
        Reference position of the tip.
    direction : ndarray, shape ``(d,)``
        Along the crack, away from it.
    radius : float
        Radius of the domain, at least some cells. Only the straight crack may lie inside.
    normal : ndarray, shape ``(3,)``, optional
        Normal of the crack in three dimensions; in two it is to the left of ``direction``.
    front : float
        Length of the straight front through the body in three dimensions. The result is the mean
        along the front.

    Raises
    ------
    ValueError
        The normal is missing in three dimensions.
    """
    frame = _frame(np.asarray(direction, dtype=float), normal)
    p, h, law = body.points, body.hierarchy, body.law
    away = p.reference - np.asarray(tip, dtype=float)
    period = np.where(h.period > 0.0, h.period, np.inf)
    away -= np.where(h.period > 0.0, h.period, 0.0) * np.round(away / period)
    near = np.flatnonzero(np.linalg.norm(away @ frame.T, axis=1) < radius)
    x = away[near] @ frame.T
    r = np.linalg.norm(x, axis=1)
    q, slope = _weight(r, radius)
    dq = (slope / np.maximum(r, np.finfo(float).tiny))[:, None] * x

    def turn(field: Floats) -> Floats:
        """Components in the plane across the front."""
        return np.asarray(np.einsum("ki,...i->...k", frame, field))

    def turn_both(field: Floats) -> Floats:
        return np.asarray(np.einsum("ki,nij,lj->nkl", frame, field[near], frame))

    F = p.F[near]
    tau, W = np.zeros_like(p.F), np.zeros(p.count)
    law.stress(near, 0, near.size, p.F, p.history, tau)
    law.energy(near, 0, near.size, p.F, p.history, W)
    if is_inelastic(law):  # W is the work of the stress, whether stored or dissipated
        lost = np.zeros(p.count)
        law.dissipation(near, 0, near.size, p.history, lost)
        W += lost
    if law.finite:
        tau[near] = np.einsum("nij,nkj->nik", tau[near], np.linalg.inv(F))
    P, H = turn_both(tau), turn_both(p.F) - np.eye(2)
    volume, mass = p.volume[near] / front, p.mass[near] / front
    v = turn(p.v[near])
    a = turn(p.dv[near]) / span[p.level[near]][:, None]
    L = np.zeros_like(p.F)
    L[near] = body.velocity_gradient(near, V)
    L = turn_both(L)
    density = W[near] + 0.5 * mass / volume * (v**2).sum(axis=1)

    sums = np.zeros(3)
    sums[0] = domain_integral(volume, P, H, density, dq)
    sums[0] += np.einsum("n,ni,ni", mass * q, a, H[:, :, 0])
    sums[0] -= np.einsum("n,ni,ni", mass * q, v, L[:, :, 0])
    if isinstance(law, LinearElastic):
        for mode in range(2):
            G = _unit_tip(x, law, mode)
            S = law.lame * np.einsum("nii->n", G)[:, None, None] * np.eye(2)
            S += law.shear * (G + G.transpose(0, 2, 1))
            mixed = np.einsum("n,nij,ni,nj", volume, P, G[:, :, 0], dq)
            mixed += np.einsum("n,nij,ni,nj", volume, S, H[:, :, 0], dq)
            mixed -= np.einsum("n,nij,nij,n", volume, P, G, dq[:, 0])
            mixed += np.einsum("n,ni,ni", mass * q, a, G[:, :, 0])
            sums[1 + mode] = mixed
    if body.mesh.ranks > 1:
        sums = body.mesh.comm.allreduce(sums)
    J1, *mixture = map(float, sums)
    if not isinstance(law, LinearElastic):
        return CrackTip(J1, None, None)
    stiffness = 4.0 * law.shear * (law.lame + law.shear) / (law.lame + 2.0 * law.shear)
    size = np.sqrt(max(J1, 0.0) * stiffness) / max(np.linalg.norm(mixture), np.finfo(float).tiny)
    K1, K2 = (float(size * part) for part in mixture)
    return CrackTip(J1, -2.0 * K1 * K2 / stiffness, (K1, K2))


def _frame(direction: Floats, normal: Floats | None) -> Floats:
    """Unit vectors along and across the crack, shape ``(2, d)``."""
    e1 = direction / np.linalg.norm(direction)
    if normal is None:
        if e1.size != 2:
            raise ValueError("a crack in three dimensions needs its normal")
        return np.array([e1, [-e1[1], e1[0]]])
    e2 = np.asarray(normal, dtype=float)
    e2 = e2 - (e2 @ e1) * e1
    return np.array([e1, e2 / np.linalg.norm(e2)])


def _weight(r: Floats, radius: float) -> tuple[Floats, Floats]:
    """The weight q at a distance from the tip, and its slope."""
    inner = PLATEAU * radius
    angle = np.pi * np.clip((r - inner) / (radius - inner), 0.0, 1.0)
    q, slope = 0.5 * (1.0 + np.cos(angle)), -0.5 * np.pi / (radius - inner) * np.sin(angle)
    return np.asarray(q), np.asarray(slope)


def _unit_tip(x: Floats, law: LinearElastic, mode: int) -> Floats:
    """Displacement gradients around a tip with K = 1 in one mode (Williams 1957), ``(n, 2, 2)``."""
    r, theta = np.linalg.norm(x, axis=1), np.arctan2(x[:, 1], x[:, 0])
    kappa = (law.lame + 3.0 * law.shear) / (law.lame + law.shear)
    step = 1e-30
    z = 0.5 * (theta + 1j * step)  # derivatives with respect to the angle by a complex step
    c, s = np.cos(z), np.sin(z)
    if mode == 0:
        g = np.stack([c * (kappa - 1.0 + 2.0 * s**2), s * (kappa + 1.0 - 2.0 * c**2)], axis=1)
    else:
        g = np.stack([s * (kappa + 1.0 + 2.0 * c**2), -c * (kappa - 1.0 - 2.0 * s**2)], axis=1)
    size = 1.0 / (2.0 * law.shear * np.sqrt(2.0 * np.pi * r))
    outward, around = 0.5 * g.real, g.imag / step  # times size: along r, and along theta
    unit = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    turned = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    gradient = np.einsum("ni,nj->nij", outward, unit) + np.einsum("ni,nj->nij", around, turned)
    return np.asarray(size[:, None, None] * gradient)
