"""A question to the continuum service: whether it can use the mesh of a case."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.processes import ENVIRONMENT
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.errors import BackendError, PeerLostError

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
    with tempfile.TemporaryDirectory(prefix="gimpmd-mesh-") as name:
        folder = Path(name)
        copy_input(case, path.parent, folder)
        dump_case(case, folder / "case.yaml")
        try:
            answer = subprocess.run(
                [sys.executable, "-m", "gimpmd_gimp.check_input", "--case", "case.yaml"],
                cwd=folder,
                env=os.environ | ENVIRONMENT,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=DEADLINE,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise PeerLostError(
                f"{path}: continuum.mesh = {continuum.mesh!r}: was not read within {DEADLINE:.0f} s"
            ) from None
    said = answer.stderr.strip()
    if answer.returncode == BackendError.exit_code:
        raise BackendError(f"{path}: {said}")
    if answer.returncode != 0:
        last = said.splitlines()[-1] if said else "it gave no reason"
        raise PeerLostError(
            f"{path}: continuum.mesh = {continuum.mesh!r}: the continuum service ended with exit "
            f"code {answer.returncode} when asked for the mesh: {last}"
        )
