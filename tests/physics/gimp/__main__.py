"""Run the gates and print a table of what was measured against what is required.

    python -m tests.physics.gimp [--short] [--markdown] [WORD ...]

With words, only the gates whose name holds one of them. Ends with 1 if a gate fails.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

from tests.physics.gimp.catalogue import GATES
from tests.physics.gimp.gates import Check, Gate

LINE = {False: "{:58s} {:>11s}  {:>20s}  {:4s}  {}", True: "| {} | {} | {} | {} | {} |"}


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.physics.gimp", description="Gates of the GIMP solver"
    )
    return run_gates(GATES, parser)


def run_gates(gates: Sequence[Gate], parser: argparse.ArgumentParser) -> int:
    """Run the gates that the command line asks for; 1 if one fails or none runs."""
    parser.add_argument("--short", action="store_true", help="leave out the long ones")
    parser.add_argument("--markdown", action="store_true", help="print the table as Markdown")
    parser.add_argument("words", nargs="*", help="run the gates whose name holds one of these")
    wanted = parser.parse_args()
    line = LINE[wanted.markdown]
    print(line.format("measured quantity", "measured", "required", "", "required by"))
    if wanted.markdown:
        print("|---|---|---|---|---|")
    failed = count = 0
    begin = time.perf_counter()
    for gate in gates:
        if wanted.short and gate.long:
            continue
        if wanted.words and not any(word in gate.name for word in wanted.words):
            continue
        start = time.perf_counter()
        checks = gate.measure()
        print(title(gate.name, time.perf_counter() - start, wanted.markdown))
        for check in checks:
            print(row(line, check), flush=True)
        failed += sum(not check.passed for check in checks)
        count += len(checks)
    print(f"\n{count - failed} of {count} checks pass, {time.perf_counter() - begin:.0f} s")
    return 1 if failed or not count else 0


def title(name: str, seconds: float, markdown: bool) -> str:
    return (
        f"| **{name}** ({seconds:.0f} s) | | | | |" if markdown else f"# {name}  ({seconds:.1f} s)"
    )


def row(line: str, check: Check) -> str:
    verdict = "pass" if check.passed else "FAIL"
    return line.format(check.what, f"{check.measured:.3g}", check.required, verdict, check.source)


if __name__ == "__main__":
    sys.exit(main())
