"""Questions to the MD service: what only LAMMPS knows of a case, before it runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gimpmd_deploy.launch.helper_command import Answer, decode, folder_of_case, run_helper
from gimpmd_schemas.case.derive.scripts import scripts as scripts_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import FreeAtoms, Probe, Repeat, Surfaces

PROBE_DEADLINE = 120.0
"""Seconds that LAMMPS gets to create the atoms of a case and answer."""

SITES_DEADLINE = 1800.0
"""The same for the sites scheme: LAMMPS then strains the sites near the planes, thirteen times.
This takes minutes with a slow potential such as SNAP."""


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


def ask_stiffness(case: Case, path: Path, folder: Path, out: str) -> FreeAtoms:
    """Let LAMMPS measure the stiffness of the atoms of a case; see `ask_lammps`.

    Parameters
    ----------
    folder : Path
        Of `folder_of_case`.
    out : str
        The file in it that is written, if the atoms are few enough.
    """
    words = ["stiffness", "--case", "case.yaml", "--out", out]
    return ask(words, folder, f"{path}: ", _names(case), FreeAtoms, SITES_DEADLINE)


def _answer(case: Case, path: Path, question: str, kind: type[Answer]) -> Answer:
    sites = question == "probe" and case.coupling.scheme == "sites"
    seconds = SITES_DEADLINE if sites else PROBE_DEADLINE
    with folder_of_case(case, path) as folder:
        words = [question, "--case", "case.yaml"]
        return ask(words, folder, f"{path}: ", _names(case), kind, seconds)


def _names(case: Case) -> str:
    """What LAMMPS reads, for messages."""
    return " and ".join(name for _, name in scripts_of(case))


def ask(
    words: Sequence[str],
    folder: Path,
    about: str,
    scripts: str,
    kind: type[Answer],
    seconds: float = PROBE_DEADLINE,
) -> Answer:
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
    seconds : float
        Time that it gets.

    Raises
    ------
    BackendError
        LAMMPS refused something; the error is its own message.
    PeerLostError
        The service crashed or gave no answer in time.
    """
    said = run_helper(
        ["gimpmd_md.service", *words],
        folder,
        about=about,
        service="the MD service",
        question=words[0],
        seconds=seconds,
        too_slow=f"LAMMPS did not finish {scripts} within {seconds:.0f} s; a script must "
        "only create the atoms and the potential, without run or minimize; if it does only "
        "that, try again when the machine is less busy",
    )
    last = said.strip().rpartition("\n")[2]
    return decode(last, kind, f"{about}the MD service gave no valid answer to the {words[0]}")
