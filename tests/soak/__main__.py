"""Inject random faults into short runs: ``python -m tests.soak [--faults N] [--seed S]``.

Each run of the small case gets one fault at a random instant. Whatever happens, it must end and
name the cause, leave no process behind, and reach the bits of an undisturbed run: by itself, after
``gimpmd resume``, or after a new start if it had no checkpoint. A table of faults and outcomes is
printed. The exit code is 1 if one of these promises is broken.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path

import h5py
import numpy as np
import psutil

from gimpmd_schemas.checkpoint.manifest import committed
from tests.cases import changed, small_case
from tests.running import Running, survivors
from tests.soak.faults import (
    CLOCK,
    CLOCK_JUMPS,
    DISK_FULL,
    FAULTS,
    READ_ONLY,
    Fault,
    Scene,
    disk,
    missing,
    names_cause,
    with_clock,
)
from tests.system.conftest import Command
from tests.system.test_resume import EVERY, differing

CASE = changed(small_case(), EVERY | {"time.end": 6.0})
"""150 coupling steps, with a checkpoint at every tenth."""

BROKEN = "BROKEN"

LIMIT = 240.0
"""Seconds within which a disturbed run must end, on a machine that does little else."""

START_SHARE, ORPHAN_SHARE = 1 / 40, 1 / 16
"""Shares of this limit: about the time until the first step; time in which all processes end."""

EARLY = 0.25
"""Share of the faults that come while the run starts."""

STOPS = ("SIGTERM to the launcher", "kill -9 the launcher")
"""Faults that stop the run at some step, where its state is renewed: this changes round-off."""

ROUND_OFF = 1e-9


def main() -> int:
    """Run the faults; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--faults", type=int, default=200, metavar="N", help="how many (200)")
    parser.add_argument("--seed", type=int, default=1, help="of the random instants and faults (1)")
    parser.add_argument("--only", default="", metavar="TEXT", help="faults with this in their name")
    parser.add_argument(
        "--limit",
        type=float,
        default=LIMIT,
        metavar="SECONDS",
        help=f"within which a disturbed run must end ({LIMIT:g}); give more on a busy machine",
    )
    options = parser.parse_args()
    names = [name for name in FAULTS if options.only in name]
    if not names:
        parser.error(f"no fault has {options.only!r} in its name; there are {', '.join(FAULTS)}")
    for name in list(names):
        if lack := missing(name):
            print(f"left out, because it needs {lack}: {name}")
            names.remove(name)
    place = Path(tempfile.mkdtemp(prefix="gimpmd-soak-"))
    outcomes = soak(names, options.faults, random.Random(options.seed), place, options.limit)
    print(table(outcomes))
    broken = any(text.startswith(BROKEN) for counts in outcomes.values() for text in counts)
    if not broken:
        shutil.rmtree(place)
    return int(broken)


def soak(
    names: Sequence[str], faults: int, chance: random.Random, place: Path, limit: float = LIMIT
) -> dict[str, Counter[str]]:
    """Disturb so many runs, by one fault after another; count the outcomes of each fault.

    Parameters
    ----------
    names : sequence of str
        Faults, keys of `FAULTS`.
    place : Path
        Empty folder. Runs that broke a promise are kept in its folder ``broken``.
    limit : float
        Seconds within which a disturbed run must end.
    """
    command = Command(place / "whole")
    whole = command.run(CASE, timeout=limit).folder
    outcomes: dict[str, Counter[str]] = {name: Counter() for name in names}
    for number in range(faults):
        name, folder = names[number % len(names)], place / f"{number:03d}"
        folder.mkdir()
        with disk(folder) if name in (DISK_FULL, READ_ONLY) else nullcontext():
            outcome = disturb(name, folder / "case", whole, chance, limit)
            if outcome.startswith(BROKEN):
                shutil.copytree(folder, place / "broken" / folder.name)
        shutil.rmtree(folder)
        outcomes[name][outcome] += 1
        print(f"{number + 1:4d} {name}: {outcome}", flush=True)
    return outcomes


def disturb(name: str, folder: Path, whole: Path, chance: random.Random, limit: float) -> str:
    """Run the small case with one fault, bring it to its end, and say how it went."""
    command = Command(folder)
    case = command.write(CASE)
    log = whole.parents[1] / f"{folder.parent.name}.txt"
    words = command.arguments("run", str(case), "--out", str(folder / "run"), "--no-figures")
    environment = dict(os.environ)
    if name == CLOCK_JUMPS:
        environment |= with_clock(folder / CLOCK)
    run = Running(words, folder / "run", log, environment)
    start = limit * START_SHARE
    early = "memory" in name  # later, processes hardly ask for more
    _wait_for_instant(run, chance, start, 1.0 if early else EARLY)
    with ExitStack() as undo:
        family = _inject(FAULTS[name], Scene(run, chance, undo), start)
        if family is None:
            return "too late"
        try:
            code = run.process.wait(limit)
        except subprocess.TimeoutExpired:
            return f"{BROKEN}: no end after {limit:g} s; {log}"
    text = run.output
    if "Traceback" in text or "internal error" in text:
        return f"{BROKEN}: no plain error; {log}"
    if orphans := survivors(family, patience=limit * ORPHAN_SHARE):
        return f"{BROKEN}: processes {orphans} are left; {log}"
    if code == 0 and "going on" in text:
        way = "went on by itself"
    elif code == 0 and "stopped at" not in text:
        way = "not disturbed"
    else:
        way = _bring_to_end(command, run, case, code, limit)
    if way not in ("not disturbed", "had ended") and not names_cause(name, text):
        return f"{BROKEN}: the cause is not named; {log}"
    return way if way.startswith(BROKEN) else _compared(way, name, whole, run)


def _compared(way: str, name: str, whole: Path, run: Running) -> str:
    """The way in which a run came to its end, if its record is that of the undisturbed run."""
    records = whole / "run.h5", run.folder / "run.h5"
    other = differing(*records)
    if not other:
        return way
    if name not in STOPS:
        return f"{BROKEN}: {len(other)} series have other bits; {run.log}"
    apart = _apart(*records)
    return f"{way}, to round-off" if apart < ROUND_OFF else f"{BROKEN}: {apart:g} apart; {run.log}"


def _wait_for_instant(run: Running, chance: random.Random, start: float, early: float) -> None:
    """Wait for a random instant: while the run starts, or after a random checkpoint."""
    if chance.random() < early:
        time.sleep(chance.uniform(0.0, start))
        return
    step = 10 * chance.randrange(1, 14)
    while run.process.poll() is None:
        found = committed(run.folder) if run.folder.exists() else []
        if found and found[0].step >= step:
            break
        time.sleep(0.01)
    time.sleep(chance.uniform(0.0, 0.5))


def _inject(fault: Fault, scene: Scene, start: float) -> list[psutil.Process] | None:
    """Disturb a run once there is what is to be disturbed; its processes, or None if it ended."""
    while scene.run.process.poll() is None:
        family = scene.run.family()
        if fault(scene):
            return family
        time.sleep(scene.chance.uniform(0.0, start))
    return None


def _apart(one: Path, other: Path) -> float:
    """Largest difference of the total energy of two runs, relative to its largest value."""
    with h5py.File(one) as a, h5py.File(other) as b:
        x, y = (file["series/total/energy"][:] for file in (a, b))
    return float(np.nanmax(np.abs(x - y)) / np.nanmax(np.abs(x)))


def _bring_to_end(command: Command, run: Running, case: Path, code: int, limit: float) -> str:
    """Resume a run, or start it anew if it has no checkpoint."""
    if run.outcome() == "completed":
        return "had ended"
    if run.folder.exists() and committed(run.folder):
        words, way = ("resume", str(run.folder)), f"resumed after code {code}"
    else:
        words = ("run", str(case), "--out", str(run.folder), "--force")
        way = f"started anew after code {code}"
    done = subprocess.run(
        command.arguments(*words, "--no-figures"),
        capture_output=True,
        text=True,
        timeout=limit,
        check=False,
    )
    if done.returncode:
        return f"{BROKEN}: {' '.join(words)}: {done.stdout}{done.stderr}; {run.log}"
    return way


def table(outcomes: dict[str, Counter[str]]) -> str:
    """A Markdown table of faults and outcomes."""
    lines = ["| fault | outcomes |", "|---|---|"]
    for name, counts in outcomes.items():
        texts = (f"{text} {number}" for text, number in sorted(counts.items()))
        lines.append(f"| {name} | {', '.join(texts)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
