"""The check of each service, then the same wave for each pair of codes.

    python -m tests.conformance [WORD ...]

Words choose among the codes. Prints Markdown tables: the checks of each service with each body, and
the pairs in two and in three dimensions. Ends with 1 if a service fails a check or a pair does not
keep the bounds of its scheme. A service or a pair that refuses a body which it need not know is no
failure; the table says why it does.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec

from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.conformance import Checked
from tests.conformance.services import Asked, services
from tests.physics import sides, sides_in_space

LONGEST = 3600.0
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


def judged(asked: Asked, code: int, results: list[Checked], said: str) -> tuple[str, list[str]]:
    """A line of the table, and what has failed.

    Parameters
    ----------
    code, results, said
        As `check` returns them.
    """
    count = {kind: [r.passed for r in results].count(kind) for kind in (True, False, None)}
    failures = [
        f"{asked.name}: {r.group}: {r.what}: expected {r.expected}, came {r.came}"
        for r in results
        if r.passed is False
    ]
    reasons = {r.came for r in results if r.passed is None}
    if not results:
        reasons = {sides_in_space.reason_of(said)}
    refused = not count[True] and not failures and (code in (0, InputError.exit_code))
    if asked.must_pass and refused:
        failures.append(f"{asked.name}: refused: {'; '.join(sorted(reasons))}")
    elif code and not failures and not refused:
        failures.append(f"{asked.name}: exit code {code}: {said.strip()}")
    why = "; ".join(sorted(reasons)).replace("|", "/")
    cells = asked.name, len(results), count[True], count[False], count[None], why
    return f"| {' | '.join(map(str, cells))} |", failures


def table(chosen: list[Asked]) -> tuple[list[str], bool]:
    """Lines of the table of checks, and whether all services pass."""
    lines = ["| service | checks | passed | failed | not made | why |", "|---|---|---|---|---|---|"]
    failures: list[str] = []
    for asked in chosen:
        line, failed = judged(asked, *check(asked.options))
        print(line, file=sys.stderr, flush=True)  # it takes long
        lines.append(line)
        failures += failed
    return [*lines, "", *failures], not failures


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="gimpmd-conformance-") as folder:
        known = services(Path(folder))
        words = sys.argv[1:] or list(dict.fromkeys(asked.code for asked in known))
        printed, all_passed = table([asked for asked in known if asked.code in words])
    print("\n".join(printed), flush=True)
    for waves in (sides.table, sides_in_space.table):
        printed, all_kept = waves(words)
        print("\n".join([*printed, ""]), flush=True)
        all_passed &= all_kept
    sys.exit(0 if all_passed else 1)
