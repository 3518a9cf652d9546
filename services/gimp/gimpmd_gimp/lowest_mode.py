"""Looks at the lowest mode of a case of the sites scheme, before it runs.

``python -m gimpmd_gimp.lowest_mode --case FILE --stiffness FILE`` prints a ``LowestMode``. The case
holds what LAMMPS has measured at the planes, and the other file is that of ``gimpmd-md stiffness``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from gimpmd_gimp.coupling.sites.layout import lay_out
from gimpmd_gimp.coupling.sites.modes import check_modes
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.stiffness import Stiffness


def main() -> int:
    """Print the mode; returns the exit code: 0, or that of the error (2: not stable)."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_gimp.lowest_mode", description=__doc__)
    parser.add_argument("--case", type=Path, required=True)
    parser.add_argument("--stiffness", type=Path, required=True)
    options = parser.parse_args()
    try:
        plan = make_plan(load_case(options.case))
        found = check_modes(plan, lay_out(plan), Stiffness.load(options.stiffness))
    except GimpmdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    sys.stdout.buffer.write(msgspec.json.encode(found) + b"\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
