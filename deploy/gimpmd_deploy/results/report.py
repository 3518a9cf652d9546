"""Summary of a run: how far and how fast it went, what took the time, what was conserved."""

from __future__ import annotations

import msgspec
import numpy as np

from gimpmd_deploy.results.findings import RunFinding
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """Summary of a run; energies in the units of the case, times in seconds, memory in bytes.

    Attributes
    ----------
    time, end : time reached, and end time of the plan.
    energy, external_work, fix_work : at the end, both sides; ``fix_work`` is the work of the user's
        own fixes.
    balance : largest absolute imbalance of energy, ``|W - D - (E - E0)|``, over the scale.
    balance_scale : name of the scale: ``external work``, ``work of loads and fixes`` or
        ``initial energy``.
    interface_loss : energy that the interface removed from both sides until the end.
    remaining_imbalance : imbalance at the end that the interface loss does not explain, over the
        scale.
    mass : of both sides at the end.
    mass_change : its largest change, relative.
    momentum : of both sides at the end, one component for each axis.
    findings : what monitors found, the first of each kind on each side.
    notes : what the user should know about the results, one sentence each.
    timings : wall seconds of each service by phase, mean over its ranks.
    busy : wall seconds of each process without waiting; shows how the load is shared.
    memory : largest resident set of each process.
    """

    name: str
    outcome: str
    steps: int
    last_step: int
    time: float
    end: float
    seconds: float | None
    atoms: int | None
    points: int | None
    steps_per_second: float | None
    atom_steps_per_second: float | None
    energy: float
    external_work: float
    fix_work: float
    balance: float
    balance_scale: str
    interface_loss: float
    remaining_imbalance: float
    mass: float
    mass_change: float
    momentum: tuple[float, ...]
    findings: tuple[RunFinding, ...]
    notes: tuple[str, ...]
    timings: dict[str, dict[str, float]]
    busy: dict[str, float]
    memory: dict[str, int]


def make_report(run: Run) -> Report:
    """Summarise what a run recorded.

    Raises
    ------
    InputError
        The folder has no record, or the run ended before its first step was recorded.
    """
    plan, energies, timings = run.plan, run.energies, run.timings
    steps = max(0, energies.time.size - 1)
    atoms = run.atoms_file.counts[0] if run.atoms_file and run.atoms_file.counts else None
    points = run.points_file.counts[0] if run.points_file and run.points_file.counts else None
    rate = steps / run.seconds if steps and run.seconds else None
    mass = energies.total("mass")
    return Report(
        name=plan.name,
        outcome=run.outcome,
        steps=steps,
        last_step=plan.steps,
        time=float(energies.time.max(initial=0.0)),
        end=plan.steps * plan.step,
        seconds=run.seconds,
        atoms=atoms,
        points=points,
        steps_per_second=rate,
        atom_steps_per_second=rate * plan.atoms.steps * atoms if rate and atoms else None,
        energy=_last(energies.energy),
        external_work=_last(energies.external_work),
        fix_work=_last(energies.fix_work),
        balance=energies.largest_imbalance(),
        balance_scale=energies.scale().name,
        interface_loss=_last(energies.interface_loss()),
        remaining_imbalance=energies.remaining_imbalance(),
        mass=_last(mass),
        mass_change=float(np.abs(mass / mass[0] - 1.0).max()) if mass.size and mass[0] else 0.0,
        momentum=tuple(_last(component) for component in energies.total("momentum").T),
        findings=run.findings,
        notes=run.notes,
        timings=timings.totals(),
        busy=dict(timings.busy),
        memory=dict(timings.memory),
    )


def _last(values: Floats) -> float:
    return float(values[-1]) if values.size else 0.0
