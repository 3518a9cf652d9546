"""Disasters that the monitors must find, and sound runs in which they must be silent.

    python -m tests.monitors [--sound NUMBER] [--first SEED] [--scheme SCHEME]

The runs take place in this process, one after another. The tables are those of docs/monitors.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.monitors.disasters import DISASTERS
from tests.monitors.running import Made, Story, run, told
from tests.monitors.sound import sound


def _run(story: Story) -> list[Made]:
    with tempfile.TemporaryDirectory(prefix="gimpmd-monitors-") as folder:
        return run(story, Path(folder))


def main() -> int:
    """Print the tables; return 1 if a monitor was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.monitors", description=__doc__)
    parser.add_argument("--sound", type=int, default=100, help="number of sound runs")
    parser.add_argument("--first", type=int, default=0, help="seed of the first sound run")
    parser.add_argument(
        "--scheme", choices=["force", "velocity", "paper"], help="scheme of all sound runs"
    )
    options = parser.parse_args()
    wrong = 0
    print("| disaster | findings, with time and value |\n|---|---|")
    for make in DISASTERS.values():
        disaster = make()
        made = _run(disaster.story)
        found = (disaster.side, disaster.kind) in [(m.side, m.finding.kind) for m in made]
        wrong += not found
        verdict = "; ".join(told(made)) if found else f"no {disaster.kind}: {'; '.join(told(made))}"
        print(f"| {disaster.about} | {verdict} |", flush=True)
    alarms = 0
    for seed in range(options.first, options.first + options.sound):
        made = _run(sound(seed, options.scheme))
        alarms += bool(made)
        for line in told(made):
            print(f"sound run {seed}: {line}", flush=True)
    print(f"\n{options.sound} sound runs, {alarms} with a false alarm")
    return 1 if wrong or alarms else 0


if __name__ == "__main__":
    sys.exit(main())
