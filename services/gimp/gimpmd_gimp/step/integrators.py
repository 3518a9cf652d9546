"""The integrators: when points deform, relative to the kick of their velocities.

Each integrator is one step of all levels from ``level`` to the finest one, composed of the stages
in ``stages.py``. The comments give the formula of each stage: i nodes, p points, S weights,
f internal and external forces, ``L_p = sum_i V_i grad S_ip``.

An integrator returns the sweeps that it leaves for the end of the step, when the nodal velocities
are known and others may be waiting for them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.grid.clock import Integrator
from gimpmd_gimp.step.stages import Stages
from gimpmd_gimp.sweeps.runner import Sweep


def musl(s: Stages, level: int) -> Sequence[Sweep]:
    """Modified update stress last: deform with the projected new momentum."""
    kick = _kick(s, level, range(level, s.clock.top + 1))
    s.sum_mass(level)  # M_i = sum_p S_ip m_p
    s.push(kick)  # dV_i = dt f_i / M_i
    s.work.add_half()
    s.kick(kick)  # v_p += sum_i S_ip dV_i, P_i = sum_p S_ip m_p v_p
    s.velocity(level)  # V_i = P_i / M_i
    s.work.add_half()
    return s.deforming(kick.levels, 1.0)  # F_p <- (1 + dt L_p) F_p, x_p += dt sum_i S_ip V_i


def usl(s: Stages, level: int) -> Sequence[Sweep]:
    """Update stress last: deform with the old nodal velocity advanced by the kick."""
    kick = _kick(s, level, range(level, s.clock.top + 1))
    s.project(level)  # M_i = sum_p S_ip m_p, V_i = sum_p S_ip m_p v_p / M_i
    s.push(kick)  # dV_i = dt f_i / M_i
    s.work.add_half()
    deforming = s.deforming(kick.levels, 1.0)  # F_p <- (1 + dt L_p) F_p, x_p += dt sum_i S_ip V_i
    s.kick(kick, 1.0, deforming)  # V_i += dV_i before; v_p += sum_i S_ip dV_i
    s.work.add_half()
    return ()


def usf(s: Stages, level: int) -> Sequence[Sweep]:
    """Update stress first: deform with the old nodal velocity, then kick and move."""
    kick = _kick(s, level, range(level, s.clock.top + 1))
    s.project(level)  # M_i = sum_p S_ip m_p, V_i = sum_p S_ip m_p v_p / M_i
    deforming = s.deforming(kick.levels, 1.0, move=False)  # F_p <- (1 + dt L_p) F_p
    s.push(kick, deforming)  # dV_i = dt f_i / M_i with the new F_p
    s.work.add_half()
    moving = s.moving(kick.levels)  # x_p += dt sum_i S_ip V_i
    s.kick(kick, 1.0, moving)  # V_i += dV_i before; v_p += sum_i S_ip dV_i
    s.work.add_half()
    return ()


def usavg(s: Stages, level: int) -> Sequence[Sweep]:
    """Update stress averaged: half a step with the old velocity, half a step with the new one.

    Loads and positions are those of the middle of the step. Coarser levels kick first and deform
    over their whole step at once (position Verlet inside velocity Verlet).
    """
    top = s.clock.top
    if level < top:
        coarser = _kick(s, level, range(level, top))
        s.sum_mass(level)  # M_i = sum_p S_ip m_p
        s.push(coarser)  # dV_i = dt f_i / M_i, forces of the coarser levels only
        s.work.add_half()
        s.kick(coarser)  # v_p += sum_i S_ip dV_i, P_i = sum_p S_ip m_p v_p
        s.velocity(level)  # V_i = P_i / M_i
        s.work.add_half()
        s.body.run(*s.deforming(coarser.levels, 1.0))  # F_p <- (1 + dt L_p) F_p, x_p += ...
    else:
        s.project(level)  # M_i = sum_p S_ip m_p, V_i = sum_p S_ip m_p v_p / M_i
    finest = Kick(top, [top], s.clock.time + 0.5 * s.clock.dt, s.clock.span)
    half = s.deforming([top], 0.5, move=False)  # F_p <- (1 + dt/2 L_p) F_p
    s.push(finest, half)  # dV_i = dt f_i / M_i with F_p in the middle of the step
    s.work.add_half()
    moving = s.moving([top])  # x_p += dt sum_i S_ip V_i
    s.kick(finest, 0.5, moving)  # V_i += dV_i / 2 before; v_p += sum_i S_ip dV_i
    s.slow(top)  # if the points are damped, V_i above was too large
    s.velocity(top)  # V_i = P_i / M_i
    s.work.add_half()
    s.body.run(*half)  # F_p <- (1 + dt/2 L_p) F_p with the new velocity
    return ()


INTEGRATORS: dict[Integrator, Callable[[Stages, int], Sequence[Sweep]]] = {
    "usavg": usavg,
    "musl": musl,
    "usl": usl,
    "usf": usf,
}


def _kick(s: Stages, coarsest: int, levels: Sequence[int]) -> Kick:
    """A kick of some levels, with loads at the present time."""
    return Kick(coarsest, levels, s.clock.time, s.clock.span)
