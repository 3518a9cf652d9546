"""Energies, mass and momentum of groups of points at the present time."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.points.groups import ALL, Group
from gimpmd_gimp.step.stages import Stages
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Floats


def bring_to_present(s: Stages, v: Floats, sign: float) -> None:
    """Add to velocities ``(n, d)`` what separates them from the present time.

    A part of the next kick leads from half steps to the present. With ``sign = -1`` the velocities
    return to the time at which their levels know them.
    """
    clock = s.clock
    if not clock.velocities_are_present():
        s.sum_mass(0)
        s.discard_prepared()
        s.push(Kick(0, clock.levels, clock.time, clock.time - clock.velocity_time))
        s.body.gather(ALL, s.nodes.dV, sign, v)


def present_velocities(s: Stages, exact: bool) -> tuple[Floats, float]:
    """Velocities of all points at the present time, and the external work until then.

    Parameters
    ----------
    exact : bool
        Bring velocities that stand half a step back to the present by a part of the next kick:
        energy, momentum and work are then those of the symplectic scheme, at the cost of half a
        step. If not, use as much of the last kick: the error is of second order in the step, and
        of first order next to the faces between levels; the state of the step is left alone, and
        the work of prescribed faces stays behind.

    Returns
    -------
    v : ndarray, shape ``(n, d)``
    work : float
    """
    clock, p = s.clock, s.body.points
    if clock.velocities_are_present():
        return p.v, s.work.external
    v = p.v.copy()
    if exact:
        bring_to_present(s, v, 1.0)
    else:
        s.sum_loads(Kick(0, clock.levels, clock.time, clock.time - clock.velocity_time))
        np.multiply(clock.share_to_present()[p.level][:, None], p.dv, out=v)
        v += p.v
    return v, s.work.external + s.work.of_loads()


def sum_energies(body: Body, v: Floats, group: Group = ALL) -> Floats:
    """Kinetic and strain energy, mass and momentum of a group, shape ``(3 + d,)``.

    Parameters
    ----------
    v : ndarray, shape ``(n, d)``
        Velocities of all points.
    """
    p, stripes, density = body.points, body.stripes(group), body.energy_density(group)

    def part(first: int, last: int) -> Floats:
        sums = np.zeros(3 + p.dim)
        kernels.sum_energies(stripes.index, first, last, p.mass, v, p.volume, density, sums)
        return sums

    return np.asarray(np.sum(body.team.gather(part, stripes), axis=0))


def strain_energy(body: Body, group: Group = ALL) -> Floats:
    """Strain energy and mass of a group now, shape ``(2,)``.

    With MUSL, before a step, the strain energy is that at the time of ``Stages.kick_sums``.
    """
    p, order, density = body.points, body.stripes(group).order, body.energy_density(group)
    return np.array([p.volume[order] @ density[order], p.mass[order].sum()])
