"""Checks of the physics: rigid motion, uniform strain, and the balances of a pulse."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from gimpmd_coupler.check.bench import Bench
from gimpmd_coupler.check.log import Log, expect
from gimpmd_coupler.check.partner import Partner, Peer
from gimpmd_coupler.check.peers import Ideal
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.form import FACES, Boundary, Initial, Stretch, VelocityField
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies

BALANCE = 0.02
"""Largest error of momentum and work, relative to what the other side has done.

A side may integrate in another way than the check, with an error of the order of the time step.
"""

MASS = 1e-9
"""Largest relative change of the mass."""

WHOLE = 1e-6
"""Largest relative error of the mass of the continuum, which fills the body up to the planes."""

RIGID = 1e-6
"""Largest error of velocities and forces in a translation, relative to the velocity, and to the
forces of a strain of velocity over wave speed."""

SPEED = 1e-3
"""Speed of a translation over that of longitudinal waves."""

STRAIN, STRAINED = 1e-5, 1e-3
"""Uniform strain, and the largest error relative to it."""

RIPPLE = 0.1
"""On levels, the largest error relative to the strain, over the square of the Courant number.

Where levels with steps of their own meet, the forces of both act at different times, and a strain
that is held ripples by an amount that is proportional to the square of the step.
"""

RIM = 1e-2
"""Speed of the rim of a body that rotates, over that of longitudinal waves."""

ROTATED = 0.01
"""Largest strain energy of a body that rotates, over its kinetic energy.

That of centrifugal stress is of the order of the square of `RIM`. A strain as large as the angle of
rotation would have more strain energy than the body has kinetic energy.
"""

_STEPS = 24


def balances(partner: Partner, log: Log) -> None:
    """Check momentum, work and energy of a run with a pulse, which has ended."""
    plan, last = partner.plan, partner.last
    ideal = Ideal(plan, partner.role, partner.needs)
    own = [partner.payload(step) for step in range(last + 1)]
    other = [ideal.pulse(step) for step in range(last + 1)]
    if partner.role == "md":  # the forces act on the nodes, and so with the other sign on the atoms
        force, velocity = [-fields["force"] for fields in own], [f["velocity"] for f in other]
    else:
        force, velocity = [fields["force"] for fields in other], [f["velocity"] for f in own]
    mean = [0.5 * (a + b) for a, b in pairwise(force)]
    impulse = plan.step * sum(one.sum(axis=0) for one in mean)
    work = plan.step * sum(float((f * v).sum()) for f, v in zip(mean, velocity[1:], strict=True))
    work = UNITS[plan.units].energy_from_mechanical(work)
    with log.checking("reports energies"):
        start, end = _energies(partner, 0), _energies(partner, last)
    if partner.role == "continuum":
        with log.checking("has the mass of the body up to the planes"):
            wanted = _mass(plan)
            off = _share(start.mass - wanted, wanted)
            log.measure(f"{off:.1g} off")
            expect(off <= WHOLE, f"{wanted:.9g} within {WHOLE:g}", f"{start.mass:.9g}")
    with log.checking("keeps its mass"):
        change = _share(end.mass - start.mass, start.mass)
        expect(change <= MASS, f"a relative change of at most {MASS:g}", f"{change:.2g}")
    with log.checking("changes its momentum by the impulse of the other side"):
        gained = np.subtract(end.momentum, start.momentum)
        off = _share(np.abs(gained - impulse).max(), np.abs(impulse).max())
        log.measure(f"{off:.1g} off")
        expect(off <= BALANCE, f"{_numbers(impulse)} within {BALANCE:.0%}", _numbers(gained))
    with log.checking("reports the work of the other side"):
        done = end.interface_work - start.interface_work
        off = _share(done - work, work)
        log.measure(f"{off:.1g} off")
        expect(off <= BALANCE, f"{work:.6g} within {BALANCE:.0%}",
               f"{done:.6g}")  # fmt: skip
    with log.checking("turns work into energy and heat"):
        energy = _energy(end) - _energy(start)
        heat = end.dissipated - start.dissipated
        done = sum(getattr(end, name) - getattr(start, name) for name in
                   ("interface_work", "external_work", "fix_work"))  # fmt: skip
        off = _share(energy + heat - done, work)
        log.measure(f"{off:.1g} off")
        expect(off <= BALANCE, f"work {done:.6g} = energy + heat within {BALANCE:.0%}",
               f"energy {energy:.6g}, heat {heat:.6g}")  # fmt: skip


def translation(bench: Bench, log: Log) -> None:
    """Check that a body which moves as a whole has neither strain nor forces."""
    plan = bench.plan(steps=_STEPS)
    speed = SPEED * plan.wave_speed("P")
    velocity: Floats = np.array([speed / 2.0**axis for axis in range(plan.dim)])
    field = VelocityField(velocity=tuple(velocity.tolist()))
    plan = bench.plan(steps=_STEPS, initial=Initial(velocities=(field,)), boundary=Boundary())
    with bench.started("translation", plan) as partner:
        _run(partner, plan, lambda ideal: ideal.motion(velocity))
        with log.checking("translates without strain"):
            start, end = _energies(partner, 0), _energies(partner, plan.steps)
            strain = _share(end.potential - start.potential, start.kinetic)
            log.measure(f"strain energy {strain:.1g} of the kinetic energy")
            expect(
                strain <= RIGID,
                f"strain energy below {RIGID:g} of the kinetic energy",
                f"{strain:.2g} of it",
            )
        if bench.role == "md":
            with log.checking("translates without forces"):
                rest = partner.payload(0)["force"]
                _check_constant(partner, "force", rest, _force(plan, SPEED), RIGID, log)
        else:
            with log.checking("translates with one velocity"):
                wanted = np.tile(velocity, (partner.offers.size, 1))
                _check_constant(partner, "velocity", wanted, speed, RIGID, log)


def uniform_strain(bench: Bench, log: Log) -> None:
    """Check that a uniform strain which goes on beyond the interface leaves the body at rest."""
    plan = bench.plan()
    dim, periodic = plan.dim, plan.domain.periodic
    gradient = STRAIN * np.array([[0.0 if p else 0.5**i for p in periodic] for i in range(dim)])
    stretch = Stretch(gradient=tuple(tuple(row) for row in gradient.tolist()))
    held = Face(condition="velocity", value=(0.0,) * dim)
    faces = {FACES[2 * a + side]: held for a in range(dim) if not periodic[a] for side in (0, 1)}
    plan = bench.plan(steps=_STEPS, initial=Initial(stretch=stretch), boundary=Boundary(**faces))
    with bench.started("uniform-strain", plan) as partner:
        _run(partner, plan, lambda ideal: ideal.strained(gradient))
        with log.checking("rests under a uniform strain"):
            end = _energies(partner, plan.steps)
            unit, most = STRAIN * plan.wave_speed("P"), _strained(plan)
            speed = np.sqrt(2.0 * UNITS[plan.units].energy_to_mechanical(end.kinetic) / end.mass)
            log.measure(f"speed {speed / unit:.1g} of strain times wave speed")
            expect(speed <= most * unit, f"a speed (rms) of at most {most * unit:.2g}",
                   f"{speed:.2g}")  # fmt: skip
        if bench.role == "md":
            with log.checking("passes the forces of the uniform strain on"):
                wanted = Ideal(plan, "continuum", partner.offers).strained(gradient)(0)["force"]
                _check_constant(partner, "force", wanted, _force(plan, STRAIN), most, log)
        else:
            with log.checking("keeps all nodes at rest"):
                still = np.zeros((partner.offers.size, dim))
                _check_constant(partner, "velocity", still, unit, most, log)


def rotation(bench: Bench, log: Log) -> None:
    """Check that a free body which rotates has no strain."""
    plan = bench.free_plan()
    if plan is None:
        log.leave_out("rotates without strain", "there is no case of a free body: --free-case")
        return
    box = np.array(plan.domain.box if bench.role == "continuum" else plan.atoms.region)
    centre, radius = box.mean(axis=1), 0.5 * np.ptp(box[:2], axis=1).max()
    gradient = np.zeros((plan.dim, plan.dim))
    gradient[1, 0] = RIM * plan.wave_speed("P") / radius
    gradient[0, 1] = -gradient[1, 0]
    field = VelocityField(
        velocity=(0.0,) * plan.dim,
        gradient=tuple(tuple(row) for row in gradient.tolist()),
        center=tuple(centre.tolist()),
    )
    free = {"steps": _STEPS, "initial": Initial(velocities=(field,)), "boundary": Boundary()}
    plan = bench.free_plan(**free)
    assert plan is not None
    with bench.started("rotation", plan, bench.block) as partner:
        partner.register()
        partner.accept(plan.steps, plan.steps)
        with log.checking("runs without another side"):
            partner.wait_for(
                lambda: partner.reported == plan.steps,
                f"the report of step {plan.steps}",
                6.0 * bench.deadline,
            )
            partner.wait_for_end(0)
        with log.checking("rotates without strain"):
            start, end = _energies(partner, 0), _energies(partner, plan.steps)
            share = _share(end.potential - start.potential, start.kinetic)
            log.measure(f"strain energy {share:.1g} of the kinetic energy")
            expect(share <= ROTATED, f"strain energy below {ROTATED:g} of the kinetic energy",
                   f"{share:.2g} of it")  # fmt: skip
            lost = _share(end.kinetic - start.kinetic, start.kinetic)
            expect(lost <= ROTATED, f"kinetic energy within {ROTATED:g}", f"{lost:.2g} off")


def _run(partner: Partner, plan: Plan, peer_of: Callable[[Ideal], Peer]) -> None:
    partner.register()
    partner.accept(plan.steps, plan.steps)
    partner.finish(peer_of(Ideal(plan, partner.role, partner.needs)))
    partner.wait_for_end(0)


def _energies(partner: Partner, step: int) -> Energies:
    dim = partner.plan.dim
    for rank in partner.ranks:
        found = rank.energies.get(step)
        expect(found is not None, f"energies at step {step}", "a report without energies")
        count = len(found.momentum) if found else 0
        expect(count == dim, f"a momentum with {dim} components", f"one with {count}")
    whole = partner.energies(step)
    assert whole is not None
    return whole


def _share(part: float, whole: float) -> float:
    """Absolute value of a part of something; infinite if there is nothing to be a part of."""
    return abs(part / whole) if whole else math.inf


def _mass(plan: Plan) -> float:
    """Mass of the continuum, which fills the body up to the planes."""
    free = sum(_volume(interface.core()) for interface in plan.coupled.interfaces)
    return float(plan.continuum.material.density * (_volume(plan.domain.box) - free))


def _volume(box: Box) -> float:
    return math.prod(high - low for low, high in box)


def _strained(plan: Plan) -> float:
    """Largest error of a uniform strain, relative to it."""
    if plan.steps_together == 1:
        return STRAINED
    courant = plan.wave_speed("P") * plan.step / plan.finest_cell
    return max(STRAINED, RIPPLE * courant**2)


def _energy(one: Energies) -> float:
    return one.kinetic + one.potential


def _force(plan: Plan, strain: float) -> float:
    """Force on the face of a cell at a strain (mass length / time^2)."""
    cell, density = plan.finest_cell, plan.continuum.material.density
    return density * plan.wave_speed("P") ** 2 * strain * cell ** (plan.dim - 1)


def _check_constant(
    partner: Partner, name: str, wanted: Floats, scale: float, share: float, log: Log
) -> None:
    """Compare a field of the payloads at all steps with one that does not change.

    Parameters
    ----------
    scale, share : float
        Of the values, and the largest error relative to it.
    """
    most = 0.0
    for step in range(partner.last + 1):
        off = float(np.abs(partner.payload(step)[name] - wanted).max(initial=0.0)) / scale
        expect(off <= share, f"{name!r} at step {step} within {share:g} of {scale:.3g}",
               f"{off:.2g} of it off")  # fmt: skip
        most = max(most, off)
    log.measure(f"{most:.1g} off")


def _numbers(values: Floats) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"
