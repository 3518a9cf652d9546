"""Questions to the continuum service: its mesh, its correction, and the lowest mode."""

from __future__ import annotations

from pathlib import Path

import psutil

from gimpmd_deploy.launch.helper_command import Answer, decode, folder_of_case, run_helper
from gimpmd_deploy.wording import quantity
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import CorrectionSize, LowestMode

DEADLINE = 600.0
"""Seconds that a code gets to answer."""


def check_mesh(case: Case, path: Path) -> None:
    """Let the continuum code of a case check the mesh of ``continuum.mesh``, if there is one.

    Parameters
    ----------
    case : Case
        Checked; with what LAMMPS has measured, if it was asked.
    path : Path
        The case file, for the mesh beside it and for messages.

    Raises
    ------
    BackendError
        The mesh cannot be used; the message names file and key.
    PeerLostError
        The continuum service crashed, or gave no answer in time.
    """
    continuum = case.continuum
    if continuum.mesh is None or continuum.command or case.only == "md":
        return
    subject = f"continuum.mesh = {continuum.mesh!r}:"
    with folder_of_case(case, path) as folder:
        run_helper(
            ["gimpmd_gimp.check_input", "--case", "case.yaml"],
            folder,
            about=f"{path}: ",
            service=f"{subject} the continuum service",
            question="mesh",
            seconds=DEADLINE,
            too_slow=f"{subject} was not read within {DEADLINE:.0f} s",
        )


def knows_sites(case: Case) -> bool:
    """Whether GIMP takes part in the sites scheme, and it is known what acts at the planes."""
    return case.only is None and case.coupling.sites is not None and not case.continuum.command


def ask_correction(case: Case, path: Path) -> CorrectionSize | None:
    """Let GIMP count how large the correction of a case is.

    Parameters
    ----------
    case : Case
        With what LAMMPS has measured, if it was asked.
    path : Path
        The case file, for messages.

    Returns
    -------
    CorrectionSize or None
        None if there is no correction, or if only LAMMPS knows where the planes are.

    Raises
    ------
    BackendError
        There is no correction for these planes.
    PeerLostError
        The continuum service crashed, or gave no answer in time.
    """
    if not knows_sites(case):
        return None
    with folder_of_case(case, path) as folder:
        words = ["gimpmd_gimp.correction_size", "--case", "case.yaml"]
        too_slow = "the correction of the sites scheme was not counted"
        return _answer(words, folder, path, "size of the correction", CorrectionSize, too_slow)


def ask_lowest_mode(path: Path, folder: Path, stiffness: str) -> LowestMode:
    """Let GIMP find the lowest mode of atoms and nodes.

    Parameters
    ----------
    path : Path
        The case file, for messages.
    folder : Path
        Of `folder_of_case`.
    stiffness : str
        The file in it with the stiffness of the atoms.

    Raises
    ------
    BackendError
        A mode has negative stiffness, or there is no correction for these planes.
    PeerLostError
        The continuum service crashed, or gave no answer in time.
    """
    words = ["gimpmd_gimp.lowest_mode", "--case", "case.yaml", "--stiffness", stiffness]
    too_slow = "the lowest mode of the sites scheme was not found"
    return _answer(words, folder, path, "lowest mode", LowestMode, too_slow)


def _answer(
    words: list[str], folder: Path, path: Path, question: str, kind: type[Answer], too_slow: str
) -> Answer:
    """What a helper command of the continuum service says of the case in a folder."""
    said = run_helper(
        words,
        folder,
        about=f"{path}: ",
        service="the continuum service",
        question=question,
        seconds=DEADLINE,
        too_slow=f"{too_slow} within {DEADLINE:.0f} s",
    )
    return decode(said, kind, f"{path}: the continuum service gave no valid {question}")


def lack_of_memory(case: Case, size: CorrectionSize | None) -> list[str]:
    """Return a warning if this machine has not the memory for all corrections of a run."""
    free = psutil.virtual_memory().available
    if size is None or case.continuum.ranks * size.memory <= free:
        return []
    return [
        f"coupling.scheme: sites: the correction takes about {quantity(size.memory)}B in each of "
        f"{case.continuum.ranks} continuum ranks, and this machine has {quantity(free)}B of memory "
        "free; where ranks find too little they refuse to start: use fewer continuum.ranks, "
        "larger cells (grid.cell), a smaller md.region, or more hosts"
    ]
