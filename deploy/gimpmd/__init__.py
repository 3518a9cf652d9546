"""gimpmd from Python: load a case, run it, and read what it wrote as numpy arrays.

``docs/python.md`` shows how to use it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rich.console import Console

from gimpmd_deploy.launch.progress import Display, Pace
from gimpmd_deploy.launch.reading import check, choose, read_case
from gimpmd_deploy.launch.run import default_folder, make_ready, start
from gimpmd_deploy.results.energies import RunEnergies, SideEnergies
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_deploy.results.timings import Timings
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError, GimpmdError, InputError, PeerLostError, StorageError

__all__ = [
    "BackendError",
    "Case",
    "GimpmdError",
    "InputError",
    "Particles",
    "PeerLostError",
    "Run",
    "RunEnergies",
    "SideEnergies",
    "StorageError",
    "Timings",
    "load",
    "open",
    "run",
]


def load(path: Path | str) -> Case:
    """Read a case file and check everything that can be checked without starting a service.

    Parameters
    ----------
    path : Path or str
        The case file.

    Returns
    -------
    Case
        Immutable; ``msgspec.structs.replace`` makes a changed copy.

    Raises
    ------
    InputError
        Lists every problem of the case, each with its key, its value and a way out.
    """
    return read_case(Path(path))


def run(
    case: Case | Path | str,
    out: Path | str | None = None,
    *,
    scripts: Path | str | None = None,
    only: Literal["md", "continuum"] | None = None,
    force: bool = False,
    ranks_md: int | None = None,
    ranks_gimp: int | None = None,
    show: bool = False,
) -> Run:
    """Run a case to its end, with the same processes as the command ``gimpmd run``.

    Ctrl-C stops the run at its next step; the returned run then has the outcome ``stopped``.

    Parameters
    ----------
    case : Case, Path or str
        A case, or the path of a case file.
    out : Path or str, optional
        The run folder; default ``runs/NAME``.
    scripts : Path or str, optional
        The folder of the LAMMPS scripts that a `Case` names; default is the current folder. The
        scripts of a case file lie beside it.
    only : ``md`` or ``continuum``, optional
        Run only this side, over the whole domain.
    force : bool
        Overwrite an earlier run in the folder.
    ranks_md, ranks_gimp : int, optional
        MPI ranks of the MD service and of the GIMP service, instead of those of the case.
    show : bool
        Print the progress.

    Raises
    ------
    InputError
        The case cannot run, or the folder cannot be used.
    BackendError
        LAMMPS or GIMP refused its input.
    PeerLostError
        A process was lost.
    StorageError
        The disk is full, or the run folder was deleted.
    """
    if isinstance(case, Case):
        path = Path(scripts or ".") / "case.yaml"
        chosen = choose(case, only, ranks_md, ranks_gimp)
        check(chosen, path)
    else:
        path = Path(case)
        chosen = read_case(path, only, ranks_md, ranks_gimp)
    ready = make_ready(chosen, path, Path(out) if out else default_folder(chosen), force)
    with Display(Console(quiet=not show), Pace.of(ready.plan, ready.probe.atoms)) as display:
        start(ready.folder, ready.services, ready.lock, display)
    return Run(ready.folder)


def open(folder: Path | str) -> Run:  # noqa: A001  # users write gimpmd.open
    """Open a run folder, also while the run goes on.

    Raises
    ------
    InputError
        The folder holds no run.
    """
    return Run(folder)
