"""Files that LAMMPS reads."""

from __future__ import annotations

import os
from pathlib import Path

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.scripts import scripts
from gimpmd_schemas.case.form import Case


def check_files(case: Case, folder: Path, rules: Rules) -> None:
    """All files that LAMMPS reads lie beside the case and are readable."""
    for key, name in scripts(case):
        path = folder / name
        if not rules.require(
            path.is_file(), key, name, "no such file beside the case", f"looked for it in {folder}"
        ):
            continue
        rules.require(
            os.access(path, os.R_OK), key, name, "cannot be read", "check its permissions"
        )
