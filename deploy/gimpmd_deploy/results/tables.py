"""A report and a comparison as tables on a console."""

from __future__ import annotations

from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gimpmd_deploy.results.compare import Comparison
from gimpmd_deploy.results.report import Report
from gimpmd_deploy.wording import clock, momentum_unit, quantity
from gimpmd_schemas.mechanics.units import UNITS, Units


def print_report(report: Report, style: str, console: Console) -> None:
    """Show a report; ``style`` is the unit style of the run."""
    console.print(_summary(report, UNITS[style]), _times(report))


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
        grid.add_row("wall time", _speed(report, report.seconds))
    grid.add_row("energy", f"{report.energy:.6g} {units.energy} at the end")
    grid.add_row("external work", f"{report.external_work:.6g} {units.energy}")
    if report.fix_work:
        grid.add_row("work of fixes", f"{report.fix_work:.6g} {units.energy}")
    balance = f"largest imbalance: {report.balance:.1e} of the {report.balance_scale}"
    grid.add_row("energy balance", balance)
    if report.atoms and report.points:
        loss = f"energy lost at the interface: {report.interface_loss:.6g} {units.energy}"
        rest = f"{report.remaining_imbalance:.1e} of the {report.balance_scale}"
        grid.add_row("interface", f"{loss}; remaining imbalance at the end: {rest}")
    mass = f"{report.mass:.6g} {units.mass}, largest relative change {report.mass_change:.1e}"
    grid.add_row("mass", mass)
    momentum = ", ".join(f"{component:.3g}" for component in report.momentum)
    grid.add_row("momentum", f"({momentum}) {momentum_unit(units)} at the end")
    for finding in report.findings:
        grid.add_row("[yellow]warning[/]", Text(finding.message))
    for note in report.notes:
        grid.add_row("note", Text(note))
    return grid


def _speed(report: Report, seconds: float) -> str:
    parts = [clock(seconds)]
    if report.steps_per_second is not None:
        parts.append(f"{report.steps_per_second:.3g} coupling steps/s")
    if report.atom_steps_per_second is not None:
        parts.append(f"{quantity(report.atom_steps_per_second)} atom-steps/s")
    return ", ".join(parts)


def _times(report: Report) -> Table:
    """Wall time by service and phase, and peak memory by process."""
    table = Table(box=SIMPLE_HEAD, title="Where the time went", title_justify="left")
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
    """Texts of all ranks of a role, in the order of the ranks."""
    ranks = [who for who in shown if who.startswith(f"{role}/")]
    return ", ".join(shown[who] for who in sorted(ranks, key=lambda who: int(who.split("/")[1])))


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Show a comparison."""
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
    for name, balance, scale in (
        (comparison.a, comparison.balance_a, comparison.balance_scale_a),
        (comparison.b, comparison.balance_b, comparison.balance_scale_b),
    ):
        grid.add_row("energy balance", name, f"largest imbalance: {balance:.1e} of the {scale}")
    console.print(grid)


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
