"""Note in ``run.h5`` how a run failed, as the process knows that watched all others.

``gimpmd run`` uses it: the coupler may have been killed, or may not know that the disk is full.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gimpmd_coupler.recorder import conclude
from gimpmd_schemas.errors import StorageError


def main() -> int:
    """Write the outcome; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_coupler.conclude", description=__doc__)
    parser.add_argument("record", type=Path, help="the file run.h5")
    parser.add_argument("outcome", help="how the run ended, on one line")
    options = parser.parse_args()
    try:
        conclude(options.record, options.outcome)
    except (OSError, StorageError) as error:
        print(f"{options.record}: {error}", file=sys.stderr)
        return StorageError.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
