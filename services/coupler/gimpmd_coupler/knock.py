"""Enter the bus of a run and leave again, to see whether the way is free.

``gimpmd doctor`` uses it. The coupler does not notice: without a token, this is no rank.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from gimpmd_coupler.bus.connection import enter
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.access import ROLES


def main() -> int:
    """Print how long it took, or why the way is not free; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_coupler.knock", description=__doc__)
    parser.add_argument("--connect", required=True, help="endpoint of the coupler")
    parser.add_argument("--keys", type=Path, required=True, help="folder of the keys, for TLS")
    parser.add_argument("--role", choices=ROLES, required=True)
    parser.add_argument("--rank", type=int, default=0)
    options = parser.parse_args()
    start = time.monotonic()
    try:
        with enter(options.connect, options.role, options.rank, options.keys):
            print(f"the coupler lets us in after {1e3 * (time.monotonic() - start):.0f} ms")
    except GimpmdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
