"""The command ``gimpmd``."""

from __future__ import annotations

import functools
import os
import sys
import tempfile
import traceback
import uuid
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, ParamSpec

import msgspec
import typer
from rich.console import Console

from gimpmd_deploy.launch import prepare
from gimpmd_deploy.launch.estimate import Estimate, estimate
from gimpmd_deploy.launch.progress import Display, MergedLogs, Pace, clock, quantity
from gimpmd_deploy.launch.supervise import Outcome, Service, Watcher, mpiexec, supervise
from gimpmd_schemas.case.checks.check import cautions
from gimpmd_schemas.case.form import Case, Role
from gimpmd_schemas.errors import BackendError, GimpmdError, InputError, Problem
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.answers import Probe

app = typer.Typer(
    name="gimpmd",
    help="Molecular dynamics (LAMMPS) coupled with the material point method (GIMP).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
strain_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.add_typer(strain_app, name="strain", help="Strain of the atoms of any LAMMPS run.")
verify_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.add_typer(verify_app, name="verify", help="What a case's own set-up can and cannot carry.")
P = ParamSpec("P")


class Side(StrEnum):
    """One side of a coupled case."""

    md = "md"
    continuum = "continuum"


CasePath = Annotated[Path, typer.Argument(metavar="CASE", help="Case file (YAML).")]
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")]
Only = Annotated[
    Side | None, typer.Option("--only", help="Run one side alone over the whole domain.")
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Run folder; runs/NAME if left out.", metavar="DIR")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite the run in the folder.")]
RanksMd = Annotated[
    int | None, typer.Option("--ranks-md", min=1, help="MPI ranks of the MD service.")
]
RanksGimp = Annotated[
    int | None, typer.Option("--ranks-gimp", min=1, help="MPI ranks of the GIMP service.")
]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]


def _told(command: Callable[P, None]) -> Callable[P, None]:
    """Turn errors into one message and an exit code; tracebacks go to a file."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except GimpmdError as error:
            _complain(str(error))
            raise typer.Exit(error.exit_code) from None
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            with tempfile.NamedTemporaryFile(
                "w", prefix="gimpmd-error-", suffix=".log", delete=False
            ) as log:
                traceback.print_exc(file=log)
            _complain(f"internal error: {error!r}; the traceback is in {log.name}")
            raise typer.Exit(3) from None

    return wrapped


def _complain(message: str) -> None:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"error: {message}", style="red" if console.is_terminal else "", markup=False)


def _console() -> Console:
    """Standard output; without a terminal lines are never folded."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=140)


@app.command()
@_told
def run(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    figures: Annotated[bool, typer.Option(help="Draw the figures at the end.")] = True,
) -> None:
    """Run a case and watch its progress; then draw its figures and report."""
    _run(case, only, out, force, ranks_md, ranks_gimp, show_logs=False, figures=figures)


@app.command()
@_told
def up(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
) -> None:
    """Start the services of a case and show their logs together; Ctrl-C stops them all."""
    _run(case, only, out, force, ranks_md, ranks_gimp, show_logs=True, figures=True)


def _run(
    path: Path,
    only: Side | None,
    out: Path | None,
    force: bool,
    ranks_md: int | None,
    ranks_gimp: int | None,
    show_logs: bool,
    figures: bool,
) -> None:
    console = _console()
    case = prepare.read_case(path, only.value if only else None, ranks_md, ranks_gimp)
    name = f"{case.name}-{case.only}" if case.only else case.name
    folder = out or Path("runs") / name
    prepare.check_folder(folder, path.parent, force)
    case, probe = _asked(case, path)
    services = _services(case, folder.absolute())  # a missing mpiexec shows before the folder
    prepare.make_folder(case, path.parent, folder)
    console.print(_headline(case, probe))
    for caution in cautions(case):
        console.print(f"warning: {caution}", style="yellow", markup=False)

    coupler, others = services
    with Display(console, Pace.of(case, probe.atoms if probe else 0)) as display:
        watcher: Watcher = display
        if show_logs:
            logs = {service.name: service.log for service in (coupler, *others(""))}
            watcher = MergedLogs(console, logs, display)
        try:
            outcome = supervise(coupler, others, watcher)
        except GimpmdError as error:
            error.args = (f"{error}\nwhat was written until then lies in {folder}",)
            raise
    _say_how_it_ended(outcome, case, console)
    _show_results(folder, console, draw=figures and not outcome.stopped)


def _asked(case: Case, path: Path) -> tuple[Case, Probe | None]:
    """The case with what LAMMPS knows of it, if it needs LAMMPS."""
    if not prepare.needs_lammps(case):
        return case, None
    probe = prepare.ask_lammps(case, path)
    return prepare.resolve(case, probe, path), probe


def _headline(case: Case, probe: Probe | None) -> str:
    cost = estimate(case, probe)
    parts = [
        f"{count:,} {what}"
        for count, what in ((cost.atoms, "atoms"), (cost.points, "material points"))
        if count
    ]
    parts.append(f"{case.steps()} steps of {case.step():g} {UNITS[case.units].time}")
    return f"{case.name}: {', '.join(parts)}"


def _services(case: Case, folder: Path) -> tuple[Service, Callable[[str], Sequence[Service]]]:
    """Commands of the coupler, and of the services given the coupler's endpoint."""
    identity = ["--run-dir", str(folder), "--run", f"{case.name}-{uuid.uuid4().hex[:12]}"]
    logs = folder / "logs"

    def module(name: str, *words: str) -> list[str]:
        return [sys.executable, "-m", f"gimpmd_{name}.service", *words, *identity]

    def launcher(role: Role) -> list[str]:
        ranks = case.ranks(role)
        return [mpiexec(), "-n", str(ranks)] if role == "md" or ranks > 1 else []

    coupler = Service("coupler", module("coupler"), logs / "coupler.log", folder)
    commands = {
        "md": ("md", module("md", "serve"), folder / "input"),
        "continuum": ("gimp", module("gimp"), folder),
    }
    launched = [(launcher(role), *commands[role]) for role in case.roles()]

    def others(endpoint: str) -> list[Service]:
        return [
            Service(name, [*mpi, *words, "--connect", endpoint], logs / f"{name}.log", cwd)
            for mpi, name, words, cwd in launched
        ]

    return coupler, others


def _say_how_it_ended(outcome: Outcome, case: Case, console: Console) -> None:
    reached = f"step {outcome.step} of {case.steps()}, t = {outcome.time:.6g}"
    if outcome.stopped:
        by_force = " (by force: the last steps may not be recorded)" if outcome.forced else ""
        console.print(f"stopped at {reached}{by_force}")
    else:
        console.print(f"finished at {reached}")


def _show_results(folder: Path, console: Console, draw: bool) -> None:
    """Figures (unless the user is in a hurry to leave) and report of what has been written."""
    from gimpmd_deploy.figures.figures import draw_all
    from gimpmd_deploy.results.reading import Run
    from gimpmd_deploy.results.report import make_report, print_report

    results = Run(folder)
    console.print(f"results in {folder}")
    if draw:
        try:
            drawn = draw_all(results)
            console.print(f"{len(drawn)} figures in {folder / 'figures'}")
        except (BackendError, InputError) as error:  # no output to draw, or no matplotlib
            console.print(f"no figures: {error}", markup=False)
    else:
        console.print(f"figures: gimpmd plot {folder}")
    try:
        print_report(results, make_report(results), console)
    except InputError as error:  # ended before the first step was recorded
        console.print(f"no report: {error}", markup=False)


@app.command()
@_told
def validate(
    case: CasePath,
    only: Only = None,
    probe: Annotated[
        bool, typer.Option("--probe", help="Let LAMMPS build the atoms and measure the material.")
    ] = False,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Draw the set-up.")
    ] = None,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    as_json: Json = False,
) -> None:
    """Check a case without running it; say what it will cost, and draw it."""
    read = prepare.read_case(case, only.value if only else None, ranks_md, ranks_gimp)
    answer = None
    if probe:
        read, answer = _asked(read, case)
    cost = estimate(read, answer)
    if picture is not None:
        from gimpmd_deploy.figures.figures import draw_setup

        _check_picture(picture)
        draw_setup(read, picture)
    if as_json:
        typer.echo(msgspec.json.encode(cost).decode())
    else:
        _print_estimate(case, read, cost, _console())


def _check_picture(path: Path) -> None:
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        problem = Problem("--picture", None, f"cannot write in {path.parent}", "make the folder")
        raise InputError(str(path), [problem])


def _print_estimate(path: Path, case: Case, cost: Estimate, console: Console) -> None:
    from rich.table import Table

    units = UNITS[case.units]
    unknown = "only LAMMPS knows: --probe asks it"

    def show(value: object | None, text: str) -> str:
        return unknown if value is None else text

    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_row("case", f"{path} is valid")
    table.add_row("sides", " and ".join(case.roles()))
    table.add_row("atoms", show(cost.atoms, f"{cost.atoms:,}" if cost.atoms is not None else ""))
    for k, level in enumerate(cost.levels):
        text = f"{level.cells:,} cells of {level.cell:g} {units.length}, {level.points:,} points"
        if level.step is not None:
            text += f", step {level.step:.4g} {units.time}"
        table.add_row(f"level {k}", text)
    table.add_row("material points", f"{cost.points:,}")
    table.add_row("grid nodes", f"{cost.nodes:,}")
    if case.only is None:
        table.add_row("coupling", _coupling(case))
    if cost.step is not None:
        text = f"{cost.steps} of {cost.step:g} {units.time}"
        if cost.md_steps is not None:
            text += f", {cost.md_steps} MD steps each"
        table.add_row("steps", text)
    else:
        table.add_row("steps", unknown)
    if case.only != "md":
        table.add_row("CFL number", show(cost.cfl, f"{cost.cfl:.2f}" if cost.cfl else ""))
    table.add_row("memory", f"about {quantity(cost.memory)}B")
    if cost.seconds is not None:
        table.add_row("wall time", f"about {clock(cost.seconds)} on this machine")
    console.print(table)


def _coupling(case: Case) -> str:
    """Scheme, and where it acts."""
    zones, unit = case.zones(), UNITS[case.units].length
    if case.coupling.scheme != "force":
        return (
            f"{case.coupling.scheme}: outer {zones.outer:g}, incommunicado {zones.incommunicado:g},"
            f" inner {zones.inner:g}, filter {zones.filter:g} {unit}"
        )
    if case.coupling.planes is None:
        return "force: between layers of atoms, which only LAMMPS knows: --probe asks it"
    found = [
        ", ".join(
            f"{face} {place:g}"
            for face, place in msgspec.structs.asdict(planes).items()
            if place is not None
        )
        for planes in case.coupling.each_planes().values()
    ]
    return f"force: planes {'; '.join(found)} {unit}"


@app.command()
@_told
def plot(
    run: RunPath,
    every: Annotated[bool, typer.Option("--all", help="Draw the stress at every output.")] = False,
) -> None:
    """Draw the figures of a run again."""
    from gimpmd_deploy.figures.figures import draw_all
    from gimpmd_deploy.results.reading import Run

    for path in draw_all(Run(run), every):
        typer.echo(str(path))


@app.command()
@_told
def report(run: RunPath, as_json: Json = False) -> None:
    """Say how far and how fast a run went, what took the time, what was conserved."""
    from gimpmd_deploy.results.reading import Run
    from gimpmd_deploy.results.report import make_report, print_report

    results = Run(run)
    summary = make_report(results)
    if as_json:
        typer.echo(msgspec.json.encode(summary).decode())
    else:
        print_report(results, summary, _console())


@app.command()
@_told
def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="Run folder, for example coupled.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Run folder, for example pure MD.")],
    as_json: Json = False,
) -> None:
    """Relative differences of run A from run B at every output time that they share."""
    from gimpmd_deploy.results.compare import compare as difference
    from gimpmd_deploy.results.reading import Run
    from gimpmd_deploy.results.report import print_comparison

    comparison = difference(Run(a), Run(b))
    if as_json:
        typer.echo(msgspec.json.encode(comparison).decode())
    else:
        print_comparison(comparison, _console())


class Normal(StrEnum):
    """Axis along which an interface is crossed."""

    x = "x"
    y = "y"


@verify_app.callback()
def _verify() -> None:
    """Measure what a case's set-up carries."""


@verify_app.command("interface")
@_told
def verify_interface(
    case: CasePath,
    wavelengths: Annotated[
        str | None,
        typer.Option("--wavelengths", help="In finest cells, between commas.", metavar="LIST"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder; runs/NAME-interface if left out.", metavar="DIR"),
    ] = None,
    force: Force = False,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="8 and 20 cells, no oblique waves, no atoms alone."),
    ] = False,
    axis: Annotated[
        Normal | None, typer.Option("--axis", help="Normal of the interface; the case's first.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="Strips at a time; as many as cores.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Send waves through the interface of a case, on strips of its own crystal."""
    from gimpmd_deploy.figures.figures import draw_crossing
    from gimpmd_deploy.verify import verify

    read = prepare.read_case(case)
    folder = out or Path("runs") / f"{read.name}-interface"
    default = verify.QUICK if quick else verify.WAVELENGTHS
    console = _console()
    verdict = verify.verify_interface(
        case,
        folder,
        default if wavelengths is None else _numbers("--wavelengths", wavelengths),
        quick=quick,
        force=force,
        axis=None if axis is None else 0 if axis is Normal.x else 1,
        jobs=jobs,
        console=Console(stderr=True) if as_json else console,
    )
    try:
        draw_crossing(verdict, folder / "interface.png")
    except BackendError as error:  # no matplotlib
        _complain(f"no figure: {error}")
    if as_json:
        typer.echo(msgspec.json.encode(verdict).decode())
    else:
        verify.print_verdict(verdict, console)
        console.print(f"results in {folder}")


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        problem = Problem(option, text, "is no list of numbers", "write for example 6,8,12")
        raise InputError("gimpmd", [problem]) from None


class StrainMethod(StrEnum):
    """How strain is computed (see docs/atomic-strain.md)."""

    incremental = "incremental"
    total = "total"
    virial = "virial"


class StrainWeights(StrEnum):
    """Weights of the grid: exact for linear fields, nearly so for quadratic ones, the paper's."""

    linear = "linear"
    quadratic = "quadratic"
    gimp = "gimp"


class StrainMeasure(StrEnum):
    """Strain tensor of the total displacement."""

    infinitesimal = "infinitesimal"
    green = "green"
    almansi = "almansi"


@strain_app.command("dump")
@_told
def strain_dump(
    dump: Annotated[Path, typer.Argument(metavar="DUMP", help="LAMMPS text dump, .gz too.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The dump with strains.")
    ] = None,
    method: Annotated[StrainMethod, typer.Option("--method")] = StrainMethod.incremental,
    reference: Annotated[
        str, typer.Option("--reference", help="Undeformed state: first, a step, or another dump.")
    ] = "first",
    cell: Annotated[float | None, typer.Option("--cell", help="Edge of the grid's cells.")] = None,
    spacing: Annotated[float | None, typer.Option("--spacing", help="Edge of an atom.")] = None,
    weights: Annotated[StrainWeights | None, typer.Option("--weights")] = None,
    measure: Annotated[StrainMeasure | None, typer.Option("--measure")] = None,
    cutoff: Annotated[
        float | None, typer.Option("--cutoff", help="Range of neighbours, for virial.")
    ] = None,
    dimension: Annotated[int | None, typer.Option("--dimension", min=2, max=3)] = None,
    ranks: Annotated[int, typer.Option("--ranks", min=1, help="MPI ranks.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the output.")] = False,
    as_json: Json = False,
) -> None:
    """Copy a dump with the strain of every atom in new columns, which OVITO opens."""
    from gimpmd_deploy.launch.strain import default_output, strain_of_dump

    options = {
        "method": method,
        "reference": reference,
        "cell": cell,
        "spacing": spacing,
        "weights": weights,
        "measure": measure,
        "cutoff": cutoff,
        "dimension": dimension,
    }
    target = out or default_output(dump)
    summary = strain_of_dump(dump, target, options, ranks, force)
    if as_json:
        typer.echo(msgspec.json.encode(summary).decode())
        return
    width = f"neighbours within {summary.cutoff:.4g}" if summary.cutoff else ""
    width = f"cells of {summary.cell:.4g}" if summary.cell else width
    typer.echo(
        f"{target}: {', '.join(summary.columns)} of {summary.atoms:,} atoms in {summary.frames} "
        f"frames ({summary.method}, {width}, from step {summary.reference})"
    )
    if summary.undefined:
        typer.echo(
            f"{summary.undefined:,} atoms of the last frame have none (nan): their neighbourhood "
            + ("is one-sided" if summary.method == "virial" else "is too sparse")
        )


def main() -> None:
    """Entry point of ``gimpmd``."""
    app()


if __name__ == "__main__":
    main()
