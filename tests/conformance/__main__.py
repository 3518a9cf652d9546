"""The check of each service, then the same wave for each pair of codes.

    python -m tests.conformance [WORD ...]

Words choose among the codes. Prints two Markdown tables; ends with 1 if a service fails a check or
a pair does not keep the bounds of its scheme.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec

from gimpmd_schemas.wire.conformance import Checked
from tests.conformance.services import services
from tests.physics import sides

LONGEST = 1800.0
"""Seconds after which a check counts as hung."""


def check(options: list[str]) -> tuple[int, list[Checked], str]:
    """Check a service; returns the exit code, the results and what is written about errors."""
    gimpmd = [sys.executable, "-m", "gimpmd_deploy.cli.app", "check", "service", "--json"]
    done = subprocess.run(
        [*gimpmd, *options], capture_output=True, text=True, timeout=LONGEST, check=False
    )
    lines = done.stdout.splitlines()
    results = [msgspec.json.decode(line, type=Checked) for line in lines]
    return done.returncode, results, done.stderr


def table(chosen: dict[str, list[str]]) -> tuple[list[str], bool]:
    """Lines of the table of checks, and whether all services pass."""
    lines = ["| service | checks | passed | failed | not made |", "|---|---|---|---|---|"]
    failures, passed = [], True
    for name, options in chosen.items():
        code, results, said = check(options)
        passed &= code == 0
        count = {kind: [r.passed for r in results].count(kind) for kind in (True, False, None)}
        lines.append(
            f"| {name} | {len(results)} | {count[True]} | {count[False]} | {count[None]} |"
        )
        failures += [
            f"{name}: {r.group}: {r.what}: expected {r.expected}, came {r.came}"
            for r in results
            if r.passed is False
        ]
        if code and not results:
            failures.append(f"{name}: {said.strip()}")
    return [*lines, "", *failures], passed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="gimpmd-conformance-") as folder:
        known = services(Path(folder))
        words = sys.argv[1:] or list(known)
        printed, all_passed = table({name: known[name] for name in words})
    print("\n".join(printed), flush=True)
    printed, all_kept = sides.table(words)
    print("\n".join(printed))
    sys.exit(0 if all_passed and all_kept else 1)
