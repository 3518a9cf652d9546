"""What a run was: how far and how fast it went, what took the time, what was conserved."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from gimpmd_deploy.launch.progress import clock, quantity
from gimpmd_deploy.results.compare import Comparison
from gimpmd_deploy.results.reading import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS, Units


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """Summary of a run; energies in the units of the case, times in seconds, memory in bytes.

    Attributes
    ----------
    timings : wall seconds of each service by phase, mean over its ranks.
    busy : wall seconds of each process but for waiting on the bus: the load of the ranks.
    memory : largest resident set of each process.
    balance : largest ``|W - D - (E - E0)|`` over the largest work, or energy at the start.
    interface_took : energy that went at the interface, from both sides together, at the end.
    unexplained : missing energy at the end, relative, that the interface did not take either.
    mass : of both sides at the end, and ``mass_change`` its largest change, relative.
    momentum : at the end, x and y.
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
    balance: float
    interface_took: float
    unexplained: float
    mass: float
    mass_change: float
    momentum: tuple[float, float]
    timings: dict[str, dict[str, float]]
    busy: dict[str, float]
    memory: dict[str, int]


def make_report(run: Run) -> Report:
    """Summarise what a run recorded.

    Raises
    ------
    InputError
        The folder has no record.
    """
    series, case = run.series, run.case
    steps = max(0, series.time.size - 1)
    atoms = run.atoms.frames[0].atoms if run.atoms and run.atoms.frames else None
    points = run.points.counts[0] if run.points and run.points.times else None
    rate = steps / series.seconds if steps and series.seconds else None
    mass = _sum(series.sides, "mass")
    return Report(
        name=case.name,
        outcome=series.outcome,
        steps=steps,
        last_step=case.steps(),
        time=float(series.time.max(initial=0.0)),
        end=case.time.end,
        seconds=series.seconds,
        atoms=atoms,
        points=points,
        steps_per_second=rate,
        atom_steps_per_second=rate * case.md_steps() * atoms if rate and atoms else None,
        energy=_last(series.energy),
        external_work=_last(series.work),
        balance=series.balance(),
        interface_took=_last(series.taken()),
        unexplained=series.unexplained(),
        mass=_last(mass),
        mass_change=float(np.abs(mass / mass[0] - 1.0).max()) if mass.size and mass[0] else 0.0,
        momentum=(
            _last(_sum(series.sides, "momentum_x")),
            _last(_sum(series.sides, "momentum_y")),
        ),
        timings={
            role: {phase: float(seconds.sum()) for phase, seconds in phases.items()}
            for role, phases in series.timings.items()
        },
        busy=series.busy,
        memory=series.memory,
    )


def _sum(sides: Mapping[str, Mapping[str, Floats]], quantity: str) -> Floats:
    return np.sum([side[quantity] for side in sides.values()], axis=0)


def _last(values: Floats) -> float:
    return float(values[-1]) if values.size else 0.0


def print_report(run: Run, report: Report, console: Console) -> None:
    """Show a report as tables."""
    units = UNITS[run.case.units]
    console.print(_summary(report, units), _times(report))


def _grid() -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim")
    return grid


def _summary(report: Report, units: Units) -> Table:
    grid = _grid()
    reached = f"step {report.steps} of {report.last_step}, t = {report.time:.6g} {units.time}"
    grid.add_row("run", f"{report.name}: {report.outcome}, {reached}")
    sizes = [
        f"{count:,} {what}"
        for count, what in ((report.atoms, "atoms"), (report.points, "material points"))
        if count is not None
    ]
    grid.add_row("size", ", ".join(sizes))
    if report.seconds is not None:
        speed = clock(report.seconds)
        if report.steps_per_second is not None:
            speed += f", {report.steps_per_second:.3g} coupling steps/s"
        if report.atom_steps_per_second is not None:
            speed += f", {quantity(report.atom_steps_per_second)} atom-steps/s"
        grid.add_row("wall time", speed)
    grid.add_row("energy", f"{report.energy:.6g} {units.energy} at the end")
    grid.add_row("external work", f"{report.external_work:.6g} {units.energy}")
    grid.add_row("energy balance", f"{report.balance:.2e} of the largest energy missing at most")
    if report.atoms and report.points:
        took = f"{report.interface_took:.6g} {units.energy}"
        rest = f"{report.unexplained:.2e} of the largest energy missing at the end but for that"
        grid.add_row("interface", f"took {took}; {rest}")
    x, y = report.momentum
    grid.add_row("mass", f"{report.mass:.6g} {units.mass}, changed by {report.mass_change:.1e}")
    grid.add_row(
        "momentum", f"({x:.3g}, {y:.3g}) {units.mass} {units.length}/{units.time} at the end"
    )
    return grid


def _times(report: Report) -> Table:
    """Wall time by service and phase, and peak memory by process."""
    table = Table(box=SIMPLE_HEAD, title="What took the time", title_justify="left")
    for name, justify in (("service", "left"), ("phase", "left"), ("seconds", "right")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    table.add_column("share", justify="right")
    table.add_column("busy, by rank (s)", justify="right")
    table.add_column("peak memory (MiB)", justify="right")
    roles = dict.fromkeys([*report.timings, *(who.split("/")[0] for who in report.memory)])
    for role in roles:
        phases = report.timings.get(role) or {"": 0.0}  # the coupler is not timed
        total = sum(phases.values())
        busy = _by_rank(role, {who: f"{s:.1f}" for who, s in report.busy.items()})
        memory = _by_rank(role, {who: f"{b / 2**20:.0f}" for who, b in report.memory.items()})
        for row, (phase, seconds) in enumerate(sorted(phases.items(), key=lambda item: -item[1])):
            table.add_row(
                role if row == 0 else "",
                phase,
                f"{seconds:.2f}" if phase else "",
                f"{seconds / total:.0%}" if total else "",
                busy if row == 0 else "",
                memory if row == 0 else "",
                end_section=row == len(phases) - 1,
            )
    return table


def _by_rank(role: str, shown: Mapping[str, str]) -> str:
    """What is shown of each rank of a role, in the order of ranks."""
    ranks = [who for who in shown if who.startswith(f"{role}/")]
    return ", ".join(shown[who] for who in sorted(ranks, key=lambda who: int(who.split("/")[1])))


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Show a comparison as a table."""
    table = Table(
        box=SIMPLE_HEAD,
        title=f"Relative L2 difference of {comparison.a} from {comparison.b}",
        title_justify="left",
    )
    for name in ("t", "u, MD region", "u, continuum", "sigma_yy, MD region", "sigma_yy, continuum"):
        table.add_column(name, justify="right")
    for row in comparison.differences:
        values = (
            row.displacement_md,
            row.displacement_continuum,
            row.stress_md,
            row.stress_continuum,
        )
        table.add_row(f"{row.time:.4g}", *(_error(value) for value in values))
    console.print(table)
    grid = _grid()
    for name, balance in (
        (comparison.a, comparison.balance_a),
        (comparison.b, comparison.balance_b),
    ):
        grid.add_row("energy balance", name, f"{balance:.2e} of the largest energy missing at most")
    console.print(grid)


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
