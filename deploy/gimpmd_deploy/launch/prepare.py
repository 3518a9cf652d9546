"""From a case file to a run folder: everything that can be wrong is found before one exists."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path, PurePath
from typing import Literal, TypeVar

import msgspec

from gimpmd_deploy.launch.supervise import ENVIRONMENT
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import Case, Hyperelastic, MeasuredByMd, PairLattice
from gimpmd_schemas.case.load import dump_case, load_case
from gimpmd_schemas.errors import BackendError, InputError, PeerLostError, Problem
from gimpmd_schemas.wire.answers import Probe, Repeat

PROBE_DEADLINE = 120.0
"""Seconds that LAMMPS gets to build the atoms of a case and answer for them."""

WRITTEN = ("case.yaml", "input", "run.h5", "fields", "atoms", "figures", "logs")
"""What a run leaves in its folder, and all that ``--force`` removes."""


Answer = TypeVar("Answer")


def read_case(
    path: Path,
    only: Literal["md", "continuum"] | None = None,
    ranks_md: int | None = None,
    ranks_gimp: int | None = None,
) -> Case:
    """Read a case, apply the command line's choices, and check form, meaning and files.

    Raises
    ------
    InputError
        With every problem that shows without LAMMPS.
    """
    case = load_case(path)
    md, continuum = case.md, case.continuum
    if ranks_md is not None and md is not None:
        md = msgspec.structs.replace(md, ranks=ranks_md)
    if ranks_gimp is not None:
        continuum = msgspec.structs.replace(continuum, ranks=ranks_gimp)
    case = msgspec.structs.replace(case, only=only or case.only, md=md, continuum=continuum)
    problems = check_case(case, path.parent) + _check_paths(case)
    if problems:
        raise InputError(str(path), problems)
    return case


def _check_paths(case: Case) -> list[Problem]:
    """Scripts are copied under their own names: these must stay inside the run folder."""
    problems = []
    for key, name in case.scripts():
        if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
            hint = "copy it there and give its name alone"
            problems.append(Problem(key, name, "lies outside the case's folder", hint))
    return problems


def needs_lammps(case: Case) -> bool:
    """Whether a case leaves something open that only LAMMPS can say."""
    return bool(case.scripts())


def ask_lammps(case: Case, path: Path) -> Probe:
    """Let LAMMPS read the scripts of a case, in a folder of its own.

    Parameters
    ----------
    case : Case
        As ``read_case`` gave it.
    path : Path
        The case file, for its scripts and for messages.

    Raises
    ------
    BackendError
        LAMMPS refused a script; the message is its own.
    PeerLostError
        The MD service broke down or gave no answer in time.
    """
    return _answer(case, path, "probe", Probe)


def ask_repeat(case: Case, path: Path) -> Repeat:
    """Let LAMMPS say how the periodic cell of a case's material repeats; as ``ask_lammps``."""
    return _answer(case, path, "cell", Repeat)


def _answer(case: Case, path: Path, question: str, kind: type[Answer]) -> Answer:
    scripts = " and ".join(name for _, name in case.scripts())
    with tempfile.TemporaryDirectory(prefix="gimpmd-probe-") as name:
        folder = Path(name)
        copy_scripts(case, path.parent, folder)
        dump_case(case, folder / "case.yaml")
        command = [sys.executable, "-m", "gimpmd_md.service", question, "--case", "case.yaml"]
        try:
            answer = subprocess.run(
                command,
                cwd=folder,
                env=os.environ | ENVIRONMENT,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=PROBE_DEADLINE,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise PeerLostError(
                f"{path}: LAMMPS did not get through {scripts} in {PROBE_DEADLINE:.0f} s; "
                "a probe needs the atoms and the potential alone, no run or minimize in the script"
            ) from None
    said = answer.stderr.strip().removeprefix("gimpmd-md: ")
    if answer.returncode == 2:
        raise BackendError(f"{path}: {said}")
    if answer.returncode != 0:
        last = said.splitlines()[-1] if said else "it said nothing"
        raise PeerLostError(
            f"{path}: the MD service ended with exit code {answer.returncode} when asked for "
            f"the {question}: {last}"
        )
    try:
        return msgspec.json.decode(answer.stdout.strip().splitlines()[-1], type=kind)
    except (msgspec.DecodeError, IndexError) as error:
        raise PeerLostError(f"{path}: the MD service's answer was no {question}: {error}") from None


def resolve(case: Case, probe: Probe, path: Path) -> Case:
    """Fill in what LAMMPS measured, and check what could not be checked before.

    Raises
    ------
    InputError
        Zones narrower than the cutoff, or a time step too long for the lattice.
    """
    problems = []
    cutoff = probe.cutoff
    if cutoff is not None:
        given = case.atoms.cutoff
        if given is not None and abs(given - cutoff) > 1e-6 * cutoff:
            hint = f"write {cutoff:g}, or leave the key out"
            message = f"is not LAMMPS's own, which is {cutoff:g}"
            problems.append(Problem("md.cutoff", given, message, hint))
        case = msgspec.structs.replace(case, md=msgspec.structs.replace(case.atoms, cutoff=cutoff))
    if isinstance(case.continuum.material, MeasuredByMd):
        model = case.continuum.material.model
        crystal = isinstance(probe.material, Hyperelastic | PairLattice)
        if probe.material is None or crystal != (model == "cauchy-born"):
            raise PeerLostError(f"{path}: the MD service measured no {model} material")
        continuum = msgspec.structs.replace(case.continuum, material=probe.material)
        case = msgspec.structs.replace(case, continuum=continuum)
    if case.only is None and case.coupling.scheme == "force":
        if probe.crystal is None or probe.planes is None:
            raise PeerLostError(f"{path}: the MD service found no crystal and no planes")
        coupling = msgspec.structs.replace(
            case.coupling, crystal=probe.crystal, planes=probe.planes
        )
        case = msgspec.structs.replace(case, coupling=coupling)
    problems += check_case(case, spacing=probe.spacing)
    if problems:
        raise InputError(str(path), problems)
    return case


def check_folder(folder: Path, source: Path, force: bool) -> None:
    """Make sure that a run folder can be made, without making it.

    Parameters
    ----------
    folder, source : Path
        Where the run is to go, and where its case lies.
    force : bool
        Whether an earlier run in the folder may be overwritten.

    Raises
    ------
    InputError
        Something is there already, or the place is not writable.
    """

    def refuse(message: str, hint: str) -> InputError:
        return InputError(str(folder), [Problem("--out", None, message, hint)])

    if folder.resolve() == source.resolve():
        raise refuse("the case itself lies there", "choose another place with --out")
    existing = next(parent for parent in (folder, *folder.parents) if os.path.lexists(parent))
    if not existing.is_dir():
        raise refuse(f"{existing} is not a folder", "choose another place with --out")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise refuse(f"no permission to write in {existing}", "choose another place with --out")
    if existing == folder and any(folder.iterdir()) and not force:
        raise refuse(
            "the folder is not empty",
            "choose another with --out, or overwrite the run in it with --force",
        )


def make_folder(case: Case, source: Path, folder: Path) -> None:
    """Make a run folder: the resolved case, and copies of its scripts in ``input/``."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in WRITTEN:
        old = folder / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
    for name in ("input", "fields", "atoms", "figures", "logs"):
        (folder / name).mkdir()
    copy_scripts(case, source, folder / "input")
    dump_case(case, folder / "case.yaml")


def copy_scripts(case: Case, source: Path, target: Path) -> None:
    """Copy the files that LAMMPS reads, each under its own name."""
    for _, name in case.scripts():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, target / name)
