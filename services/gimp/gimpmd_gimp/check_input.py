"""Asks a continuum code whether it can use the files of a case, before the case runs.

``python -m gimpmd_gimp.check_input --case FILE``. A code that reads files has a static method
``check_input(case, folder)``, which raises a ``BackendError`` that names the key; one without it
has nothing to say.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.registry import load_code


def main() -> int:
    """Check the files; returns the exit code: 0, or that of the error (2: bad input)."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_gimp.check_input", description=__doc__)
    parser.add_argument("--case", type=Path, required=True, help="with its files beside it")
    path = parser.parse_args().case
    try:
        case = load_case(path)
        check = getattr(load_code("continuum", case.continuum.backend), "check_input", None)
        if check is not None:
            check(case, path.parent)
    except GimpmdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
