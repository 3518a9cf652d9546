"""Files that the services read, and the program of a continuum service in any language."""

from __future__ import annotations

import os
from pathlib import Path

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.program import program
from gimpmd_schemas.case.derive.scripts import input_files
from gimpmd_schemas.case.form import Case


def check_files(case: Case, folder: Path, rules: Rules) -> None:
    """The files that services read lie beside the case and are readable; the program is there."""
    for key, name in input_files(case):
        path = folder / name
        if not rules.require(
            path.is_file(), key, name, "no such file beside the case", f"looked for it in {folder}"
        ):
            continue
        rules.require(
            os.access(path, os.R_OK), key, name, "cannot be read", "check its permissions"
        )
    command, backend = case.continuum.command, case.continuum.backend
    if command and case.only != "md":
        rules.require(
            program(command[0], folder) is not None,
            "continuum.command",
            command[0],
            "no such program",
            f"build it first; a name with a slash is a path from {folder}, and others are looked "
            "for on the PATH",
        )
        rules.require(
            backend == "gimp",
            "continuum.backend",
            backend,
            "is given in addition to a command; only one of them can be the continuum",
            "leave out continuum.backend or continuum.command",
        )
