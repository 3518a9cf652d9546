"""Says how large the correction of the sites scheme is, before a case runs.

``python -m gimpmd_gimp.correction_size --case FILE`` prints a ``CorrectionSize``. The case holds
what LAMMPS has measured at the planes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from gimpmd_gimp.coupling.sites.layout import lay_out
from gimpmd_gimp.coupling.sites.memory import size_of_correction
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import GimpmdError


def main() -> int:
    """Print the size; returns the exit code: 0, or that of the error (2: bad input)."""
    parser = argparse.ArgumentParser(
        prog="python -m gimpmd_gimp.correction_size", description=__doc__
    )
    parser.add_argument("--case", type=Path, required=True)
    try:
        size = size_of_correction(lay_out(make_plan(load_case(parser.parse_args().case))))
    except GimpmdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    sys.stdout.buffer.write(msgspec.json.encode(size) + b"\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
