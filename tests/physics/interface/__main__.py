"""Run the gates and print a table of what was measured against what is required.

    python -m tests.physics.interface [--scheme NAME] [--short] [--markdown] [WORD ...]

With words, only the gates whose name holds one of them. Ends with 1 if a gate fails.
``python -m tests.physics.interface.table`` prints reflection and transmission of all schemes.
"""

from __future__ import annotations

import argparse
import sys

from tests.physics.gimp.__main__ import run_gates
from tests.physics.interface.catalogue import gates_of
from tests.physics.interface.schemes import SCHEMES


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.physics.interface", description="Gates of a coupling"
    )
    parser.add_argument("--scheme", choices=tuple(SCHEMES), help="this one alone")
    scheme = parser.parse_known_args()[0].scheme
    gates = [gate for name in SCHEMES if scheme in (None, name) for gate in gates_of(name)]
    return run_gates(gates, parser)


if __name__ == "__main__":
    sys.exit(main())
