"""What the interface of a case carries: waves on strips of its own crystal, and the verdict.

Every strip runs by ``gimpmd run`` in processes of its own.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from gimpmd_deploy.launch import prepare
from gimpmd_deploy.results.reading import Run
from gimpmd_deploy.verify.strips import SCRIPT, Ground, Travel, Wave, crossing
from gimpmd_schemas.case.form import Case, MeasuredByMd
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.errors import BackendError, InputError, PeerLostError, Problem

WAVELENGTHS = (6.0, 8.0, 12.0, 20.0, 40.0)
QUICK = (8.0, 20.0)
SHORTEST = 3.0
"""Shortest wavelength (cells) that is worth asking for: two cells carry none."""
ANGLE = 30.0
"""Of the oblique waves (degrees), as nearly as a strip can have it."""
LONGEST_OBLIQUE = 12.0
"""Longest oblique wave (cells): their strips are about twice as wide as the wave is long."""

MORE_REFLECTED, OFF_TRANSMITTED = 0.01, 0.03
CRITERION = (
    f"R at most the grid's own + {MORE_REFLECTED:g}, T within {OFF_TRANSMITTED:g} of 1, "
    "into the atoms and out of them, P and S"
)

KINDS: tuple[Literal["P", "S"], ...] = ("P", "S")

Alone = Literal["continuum", "md"]


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of a packet's energy that one wave leaves behind the interface and takes across.

    Attributes
    ----------
    wavelength : in cells.
    degrees : angle to the interface's normal.
    travel : ``into`` the atoms or ``out`` of them.
    grid_reflected, grid_transmitted : of the same packet on the continuum alone.
    md_reflected, md_transmitted : among atoms alone; null if not run.
    faithful : whether the criterion holds.
    """

    wavelength: float
    polarization: Literal["P", "S"]
    degrees: float
    travel: Travel
    reflected: float
    transmitted: float
    grid_reflected: float
    grid_transmitted: float
    md_reflected: float | None
    md_transmitted: float | None
    faithful: bool


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """What the interface of a case carries.

    Attributes
    ----------
    cell : edge of the strips' cells.
    case_cell : that of the case's finest.
    shortest : shortest wavelength (cells) from which on all that was run is faithful; null: none.
    """

    case: str
    scheme: str
    md_steps: int
    axis: Literal["x", "y"]
    cell: float
    case_cell: float
    criterion: str
    shortest: float | None
    rows: list[Row]


@dataclass(frozen=True)
class Task:
    """One strip to run."""

    wave: Wave
    travel: Travel
    only: Alone | None = None

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.wave.label}-{self.only or self.travel}"


Done = Callable[[Task], None]


def make_ground(case: Case, path: Path, axis: Literal[0, 1] | None) -> Ground:
    """Crystal of a case and the way strips are cut from it; LAMMPS is asked.

    Parameters
    ----------
    case : Case
        As ``prepare.read_case`` gave it.
    path : Path
        The case file.
    axis : 0, 1 or None
        Normal of the interface; None takes the first along which the case has one.

    Raises
    ------
    InputError
        The case names no periodic cell, or has no interface.
    """
    if case.md is None or case.only is not None:
        problem = Problem("only", case.only, "leaves nothing to couple", "leave the key out")
        raise InputError(str(path), [problem])
    material = case.continuum.material
    if not isinstance(material, MeasuredByMd):
        hint = (
            "write material: {from: md, cell: bulk.in}, with a LAMMPS script that makes a periodic "
            "cell of the crystal (docs/case.md)"
        )
        message = "names no periodic cell of the crystal, and the strips are made of it"
        raise InputError(str(path), [Problem("continuum.material", None, message, hint)])
    repeat = prepare.ask_repeat(case, path)
    resolved = prepare.resolve(case, prepare.ask_lammps(case, path), path)
    if axis is None:
        axis = 0 if any(case.zones().regions[0].interfaces[0]) else 1
    return Ground.of(resolved, material.cell, repeat, axis)


def plan(ground: Ground, wavelengths: Sequence[float], quick: bool) -> list[Task]:
    """All strips to run, the longest first."""
    waves = [Wave(length, kind) for length in wavelengths for kind in KINDS]
    if not quick:
        waves += [
            ground.oblique(length, kind, ANGLE)
            for length in wavelengths
            if length <= LONGEST_OBLIQUE
            for kind in KINDS
        ]
    waves.sort(key=lambda wave: (wave.wavelength, wave.degrees), reverse=True)
    tasks = []
    for wave in waves:
        tasks += [Task(wave, "into"), Task(wave, "out"), Task(wave, "into", "continuum")]
        if not quick:
            tasks.append(Task(wave, "into", "md"))
    return tasks


def run_strip(ground: Ground, task: Task, source: Path, folder: Path) -> tuple[float, float]:
    """Run one strip by the command; its reflected and transmitted share of energy.

    Parameters
    ----------
    source : Path
        Where the case's scripts lie.
    folder : Path
        Where the strip's case, scripts and run go.

    Raises
    ------
    BackendError, PeerLostError
        The run failed; the message is its own.
    """
    case = ground.strip(task.wave, task.travel)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SCRIPT).write_text(ground.lammps(case), encoding="utf-8")
    for name in case.atoms.files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, folder / name)
    dump_case(case, folder / "case.yaml")
    run = folder / "run"
    words = ["run", str(folder / "case.yaml"), "--out", str(run), "--force", "--no-figures"]
    if task.only is not None:
        words += ["--only", task.only]
    done = subprocess.run(
        [sys.executable, "-m", "gimpmd_deploy.cli.app", *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode != 0:
        kind = BackendError if done.returncode == BackendError.exit_code else PeerLostError
        raise kind(f"strip {task.name}: {done.stderr.strip().removeprefix('error: ')}")
    return crossing(Run(run))


def run_strips(
    ground: Ground, tasks: Sequence[Task], source: Path, folder: Path, jobs: int, done: Done
) -> dict[Task, tuple[float, float]]:
    """Run strips, some at a time; ``done`` is called after each. Stops at the first that fails."""
    shares = {}
    with ThreadPoolExecutor(jobs) as pool:
        futures = {
            pool.submit(run_strip, ground, task, source, folder / task.name): task for task in tasks
        }
        try:
            for future in as_completed(futures):
                shares[futures[future]] = future.result()
                done(futures[future])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return shares


def judge(ground: Ground, shares: Mapping[Task, tuple[float, float]]) -> Verdict:
    """What the strips show; rows by wavelength, angle, polarization and way."""
    rows = []
    coupled = [task for task in shares if task.only is None]
    for task in sorted(coupled, key=lambda t: (t.wave.wavelength, t.wave.degrees, t.name)):
        reflected, transmitted = shares[task]
        grid = shares[Task(task.wave, "into", "continuum")]
        md = shares.get(Task(task.wave, "into", "md"), (None, None))
        rows.append(
            Row(
                wavelength=task.wave.wavelength,
                polarization=task.wave.polarization,
                degrees=task.wave.degrees,
                travel=task.travel,
                reflected=reflected,
                transmitted=transmitted,
                grid_reflected=grid[0],
                grid_transmitted=grid[1],
                md_reflected=md[0],
                md_transmitted=md[1],
                faithful=is_faithful(reflected, transmitted, grid[0]),
            )
        )
    case = ground.case
    return Verdict(
        case=case.name,
        scheme=case.coupling.scheme,
        md_steps=case.md_steps(),
        axis="xy"[ground.axis],  # type: ignore[arg-type]
        cell=ground.cell,
        case_cell=case.finest_cell(),
        criterion=CRITERION,
        shortest=shortest_faithful(rows),
        rows=rows,
    )


def is_faithful(reflected: float, transmitted: float, grid_reflected: float) -> bool:
    """Whether a wave crosses as the criterion asks."""
    return (
        reflected <= grid_reflected + MORE_REFLECTED and abs(transmitted - 1.0) <= OFF_TRANSMITTED
    )


def shortest_faithful(rows: Iterable[Row]) -> float | None:
    """Shortest wavelength that is faithful, as all longer ones are; None if the longest is not."""
    shortest = None
    by_length: dict[float, bool] = {}
    for row in rows:
        by_length[row.wavelength] = by_length.get(row.wavelength, True) and row.faithful
    for length in sorted(by_length, reverse=True):
        if not by_length[length]:
            break
        shortest = length
    return shortest


def verify_interface(
    path: Path,
    folder: Path,
    wavelengths: Sequence[float],
    *,
    quick: bool,
    force: bool,
    axis: Literal[0, 1] | None,
    jobs: int | None,
    console: Console,
) -> Verdict:
    """Run the strips of a case into a folder; write ``interface.json`` and draw the curves.

    Raises
    ------
    InputError
        The case cannot serve, or the folder is not free.
    BackendError, PeerLostError
        A strip failed.
    """
    short = [length for length in wavelengths if not SHORTEST <= length < np.inf]
    if short or not wavelengths:
        hint = "for example --wavelengths 6,8,12,20,40"
        message = f"must be numbers of cells, {SHORTEST:g} or more"
        raise InputError(str(path), [Problem("--wavelengths", list(wavelengths), message, hint)])
    case = prepare.read_case(path)
    prepare.check_folder(folder, path.parent, force)
    ground = make_ground(case, path, axis)
    tasks = plan(ground, sorted(set(wavelengths)), quick)
    folder.mkdir(parents=True, exist_ok=True)
    count = jobs or len(os.sched_getaffinity(0))
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        line = bar.add_task("strips", total=len(tasks))
        shares = run_strips(
            ground, tasks, path.parent, folder / "strips", count, lambda _: bar.advance(line)
        )
    verdict = judge(ground, shares)
    text = msgspec.json.format(msgspec.json.encode(verdict), indent=2)
    (folder / "interface.json").write_bytes(text)
    return verdict


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Table of all rows, then what they mean."""
    table = Table(box=None, header_style="bold")
    for name in ("wave", "angle", "way", "R", "T", "grid R", "grid T", "MD R", "MD T", ""):
        table.add_column(name, justify="left" if name in ("wave", "way", "") else "right")
    for row in verdict.rows:
        table.add_row(
            f"{row.polarization} {row.wavelength:g} h",
            f"{row.degrees:.0f}",
            row.travel,
            *(
                "-" if share is None else f"{share:.4f}"
                for share in (
                    row.reflected,
                    row.transmitted,
                    row.grid_reflected,
                    row.grid_transmitted,
                    row.md_reflected,
                    row.md_transmitted,
                )
            ),
            "" if row.faithful else "not faithful",
        )
    console.print(table)
    console.print(
        f"scheme {verdict.scheme}, N = {verdict.md_steps}, interface across {verdict.axis}"
    )
    if abs(verdict.cell - verdict.case_cell) > 1e-6 * verdict.case_cell:
        console.print(
            f"h = {verdict.cell:.6g}, the case's {verdict.case_cell:g} made to fit the crystal"
        )
    console.print(f"faithful: {verdict.criterion}")
    if verdict.shortest is None:
        console.print("no wavelength that was run is carried faithfully")
    else:
        console.print(
            f"shortest wavelength carried faithfully: {verdict.shortest:g} h = "
            f"{verdict.shortest * verdict.cell:.4g}"
        )
