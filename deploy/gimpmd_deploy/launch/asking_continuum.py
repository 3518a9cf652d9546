"""A question to the continuum service: whether it can use the mesh of a case."""

from __future__ import annotations

from pathlib import Path

from gimpmd_deploy.launch.helper_command import folder_of_case, run_helper
from gimpmd_schemas.case.form import Case

DEADLINE = 600.0
"""Seconds that a code gets to read a mesh."""


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
