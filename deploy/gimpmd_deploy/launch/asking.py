"""Questions to the MD service: what only LAMMPS knows of a case, before it runs."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.processes import ENVIRONMENT
from gimpmd_schemas.case.derive.scripts import scripts as scripts_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.answers import Probe, Repeat, Surfaces

PROBE_DEADLINE = 120.0
"""Seconds that LAMMPS gets to create the atoms of a case and answer."""


Answer = TypeVar("Answer")


def needs_lammps(case: Case) -> bool:
    """Whether a case leaves something open that only LAMMPS can answer."""
    return bool(scripts_of(case))


def ask_lammps(case: Case, path: Path) -> Probe:
    """Let LAMMPS read the scripts of a case, in a temporary folder.

    Parameters
    ----------
    case : Case
        As ``read_case`` gave it.
    path : Path
        The case file, for its scripts and for messages.

    Raises
    ------
    BackendError
        LAMMPS refused a script; the error is LAMMPS's own message.
    PeerLostError
        The MD service crashed or gave no answer in time.
    """
    return _answer(case, path, "probe", Probe)


def ask_repeat(case: Case, path: Path) -> Repeat:
    """Let LAMMPS say how the periodic cell of the material repeats; see `ask_lammps`."""
    return _answer(case, path, "cell", Repeat)


def ask_surfaces(case: Case, path: Path) -> Surfaces:
    """Let LAMMPS measure the surface energies of the material; see `ask_lammps`."""
    return _answer(case, path, "surfaces", Surfaces)


def _answer(case: Case, path: Path, question: str, kind: type[Answer]) -> Answer:
    scripts = " and ".join(name for _, name in scripts_of(case))
    with tempfile.TemporaryDirectory(prefix="gimpmd-probe-") as name:
        folder = Path(name)
        copy_input(case, path.parent, folder)
        dump_case(case, folder / "case.yaml")
        return ask([question, "--case", "case.yaml"], folder, f"{path}: ", scripts, kind)


def ask(words: Sequence[str], folder: Path, about: str, scripts: str, kind: type[Answer]) -> Answer:
    """Run a helper command of the MD service in a process of its own.

    Parameters
    ----------
    words : sequence of str
        The command and its options.
    folder : Path
        Working directory.
    about : str
        What messages begin with.
    scripts : str
        What LAMMPS reads, for messages.
    kind : type
        Type of the answer.

    Raises
    ------
    BackendError
        LAMMPS refused something; the error is its own message.
    PeerLostError
        The service crashed or gave no answer in time.
    """
    try:
        # its temporary folders lie in one of ours, so that they go even if it is killed
        with tempfile.TemporaryDirectory(prefix="gimpmd-probe-") as temporary:
            answer = subprocess.run(
                [sys.executable, "-m", "gimpmd_md.service", *words],
                cwd=folder,
                env=os.environ | ENVIRONMENT | {"TMPDIR": temporary},
                capture_output=True,
                text=True,
                errors="replace",
                timeout=PROBE_DEADLINE,
                check=False,
            )
    except subprocess.TimeoutExpired:
        raise PeerLostError(
            f"{about}LAMMPS did not finish {scripts} within {PROBE_DEADLINE:.0f} s; a "
            "script must only create the atoms and the potential, without run or minimize"
        ) from None
    said = answer.stderr.strip().removeprefix("gimpmd-md: ")
    if answer.returncode == 2:
        raise BackendError(f"{about}{said}")
    if answer.returncode != 0:
        last = said.splitlines()[-1] if said else "it gave no reason"
        raise PeerLostError(
            f"{about}the MD service ended with exit code {answer.returncode} when asked for "
            f"the {words[0]}: {last}"
        )
    try:
        return msgspec.json.decode(answer.stdout.strip().splitlines()[-1], type=kind)
    except (msgspec.DecodeError, IndexError) as error:
        raise PeerLostError(
            f"{about}the MD service gave no valid answer to the {words[0]}: {error}"
        ) from None
