"""``gimpmd verify interface``: run waves on strips of a crystal, and judge how they cross.

Each strip is run by ``gimpmd run`` in processes of its own.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from gimpmd_deploy.launch.asking import ask_lammps, ask_repeat
from gimpmd_deploy.launch.folder import check_folder
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.results.run import Run
from gimpmd_deploy.verify.crossing import crossing
from gimpmd_deploy.verify.strips import MISFIT, SCRIPT, Axis, Ground
from gimpmd_deploy.verify.tasks import Task, plan_tasks
from gimpmd_deploy.verify.verdict import Verdict, judge
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.errors import BackendError, InputError, PeerLostError, Problem
from gimpmd_schemas.resolve import fill_in
from gimpmd_schemas.run_lock import take_lock

SHORTEST = 3.0
"""Shortest wavelength (cells) that is accepted: the grid cannot represent two cells."""

Done = Callable[[Task], None]


def make_ground(case: Case, path: Path, axis: Axis | None) -> Ground:
    """Ask LAMMPS for the crystal of a case, and choose how strips are cut from it.

    Parameters
    ----------
    case : Case
        Checked.
    path : Path
        The case file.
    axis : 0, 1, 2 or None
        Normal of the interface; None takes the first axis along which the case has an interface
        and a strip can be cut.

    Raises
    ------
    InputError
        The case does not name a periodic cell of the crystal, has no interface or no such axis, or
        the crystal does not repeat together with any grid.
    """
    if case.md is None or case.only is not None:
        problem = Problem(
            "only",
            case.only,
            "leaves only one side, so there is nothing to couple",
            "leave the key out",
        )
        raise InputError(str(path), [problem])
    if axis is not None and axis >= case.dim:
        problem = Problem(
            "--axis", "xyz"[axis], "is no axis of a body of two dimensions", "write x or y"
        )
        raise InputError(str(path), [problem])
    material = case.continuum.material
    if not isinstance(material, MeasuredByMd):
        hint = (
            "write material: {from: md, cell: bulk.in}, with a LAMMPS script for a periodic "
            "cell of the crystal (docs/case.md)"
        )
        message = "gives no periodic cell of the crystal, from which the strips are made"
        raise InputError(str(path), [Problem("continuum.material", None, message, hint)])
    repeat = ask_repeat(case, path)
    resolved = fill_in(case, ask_lammps(case, path), path)
    normals = interfaces_of(case) if axis is None else (axis,)
    for normal in normals:
        try:
            return Ground.of(resolved, material.cell, repeat, normal)
        except ValueError:
            continue
    message = (
        f"has a crystal with periods of {', '.join(f'{p:g}' for p in repeat.period)}, which no "
        f"cells of {1.0 - MISFIT:g} h to h fit at once across a strip along "
        f"{' or '.join('xyz'[normal] for normal in normals)}"
    )
    hint = "try --axis, another grid.cell, or a crystal turned so that two periods are alike"
    raise InputError(str(path), [Problem("continuum.material.cell", material.cell, message, hint)])


def interfaces_of(case: Case) -> tuple[Axis, ...]:
    """Axes along which the first region of atoms has an interface."""
    sides = zones(case).regions[0].interfaces
    axes: tuple[Axis, ...] = (0, 1, 2)
    return tuple(axis for axis in axes[: case.dim] if any(sides[axis]))


def run_strip(ground: Ground, task: Task, source: Path, folder: Path) -> tuple[float, float]:
    """Run one strip by ``gimpmd run``; return the fractions of energy reflected and transmitted.

    Parameters
    ----------
    source : Path
        Where the scripts of the case lie.
    folder : Path
        Where the case, scripts and run of the strip go.

    Raises
    ------
    BackendError, PeerLostError
        The run failed; the error is its own message.
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
    """Run strips, ``jobs`` at a time; call ``done`` after each; stop at the first that fails."""
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


def verify_interface(
    path: Path,
    folder: Path,
    wavelengths: Sequence[float],
    *,
    quick: bool,
    force: bool,
    axis: Axis | None,
    jobs: int | None,
    console: Console,
) -> Verdict:
    """Run the strips of a case in a folder, and write ``interface.json``.

    Raises
    ------
    InputError
        The case cannot be verified, or the folder cannot be used.
    BackendError, PeerLostError
        A strip failed.
    """
    short = [length for length in wavelengths if not SHORTEST <= length < np.inf]
    if short or not wavelengths:
        hint = "for example --wavelengths 6,8,12,20,40"
        message = f"must be numbers of cells, {SHORTEST:g} or more"
        raise InputError(str(path), [Problem("--wavelengths", list(wavelengths), message, hint)])
    case = read_case(path)
    check_folder(folder, path.parent, force)
    ground = make_ground(case, path, axis)
    tasks = plan_tasks(ground, sorted(set(wavelengths)), quick)
    folder.mkdir(parents=True, exist_ok=True)
    count = jobs or len(os.sched_getaffinity(0))
    with (
        take_lock(folder),
        Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        ) as bar,
    ):
        line = bar.add_task("strips", total=len(tasks))
        shares = run_strips(
            ground, tasks, path.parent, folder / "strips", count, lambda _: bar.advance(line)
        )
    verdict = judge(ground, shares)
    text = msgspec.json.format(msgspec.json.encode(verdict), indent=2)
    (folder / "interface.json").write_bytes(text)
    return verdict
