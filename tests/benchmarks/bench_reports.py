"""What a report of a rank costs the coupler's Python: ``make bench-reports``.

The real coupler takes reports of ranks that are not there, without a bus: it decodes, checks and
answers them, sums the energies and writes the record. Each rank reports twice a second, and the
record is flushed every three seconds, so one flush goes with six reports of each rank.

Columns: ranks of both sides; processor time of a report in the thread of the bus, of which one part
decodes it; in the main thread, which records complete steps; in flushes; the sum; size of the
record.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_coupler.bus.hub import Request
from gimpmd_coupler.checkpoints import Checkpoints
from gimpmd_coupler.coupler import Coupler
from gimpmd_coupler.recorder import Recorder
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Member,
    Register,
    Report,
    StepReport,
    decode,
    encode,
)
from tests.benchmarks.bench_ranks import Setting

RANKS = (2, 64, 128, 256)
PHASES = ("drive", "lammps", "project", "finish", "wait")
ENERGIES_EVERY, OUTPUT_EVERY = 10, 12
FLUSH_EVERY = 6  # reports of a rank
NO_NODES = {kind: np.empty(0, np.int64) for kind in ("offers", "needs")}


class Nobody:
    """Takes the answers."""

    def send(self, *message: object) -> None:
        """Forget an answer."""


def request(kind: str, member: Member, data: bytes) -> Request:
    """What arrives from a rank."""
    role, rank = member
    return Request(kind, role, str(rank), data, b"", Nobody())


def register(plan: Plan, member: Member) -> bytes:
    """Registration of a rank."""
    role, rank = member
    message = Register(
        protocol=PROTOCOL_VERSION,
        run="bench",
        plan=plan.digest(),
        role=role,
        rank=rank,
        ranks=plan.ranks(role),
        backend="bench",
        units=plan.units,
        dt=plan.step,
        patch=plan.domain.box,
        host="bench",
        pid=1,
    )
    return encode(message, NO_NODES)


def report(member: Member, first: int, steps: int) -> bytes:
    """Report of a rank on some steps, with random values."""
    role, rank = member
    chance = random.Random(1000 * first + rank).random
    names = ("kinetic", "potential", "external_work", "interface_work", "dissipated", "mass")
    made = []
    for step in range(first, first + steps):
        energies = Energies(**{n: chance() for n in names}, momentum=(chance(), chance()))
        timings = {phase: 0.01 * chance() for phase in PHASES}
        if step % OUTPUT_EVERY == 0:
            timings["output"] = chance()
        known = energies if step % ENERGIES_EVERY == 0 else None
        made.append(StepReport(step=step, energies=known, timings=timings))
    return encode(Report(role=role, rank=rank, steps=tuple(made), peak_memory=2**27))


class Stopwatch:
    """Adds up processor time (seconds)."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def time(self, act: Callable[[], Any]) -> Any:
        """Do something and add its time."""
        start = time.process_time()
        done = act()
        self.seconds += time.process_time() - start
        return done


def measure(ranks: int, steps: int, rounds: int) -> str:
    """Let all ranks report some times; a line of the table."""
    plan = make_plan(Setting(ranks, 2, 0.0).case())
    bus, decoding, main, flushing = (Stopwatch() for _ in range(4))
    with tempfile.TemporaryDirectory(prefix="bench-reports-") as folder:
        path = Path(folder) / "run.h5"
        recorder = Recorder(path, "", plan.units)
        recorder._flush_at = float("inf")  # we flush
        checkpoints = Checkpoints(Path(folder), plan, 0.0)
        coupler = Coupler("bench", plan, lambda event: None, recorder, checkpoints, float("inf"))
        members = [(role, rank) for role in plan.roles for rank in range(plan.ranks(role))]
        for member in members:
            coupler.take(request("register", member, register(plan, member)))
        coupler._grants.granted = plan.steps  # the pace of the ranks is no matter here
        for count in range(rounds):
            frames = {member: report(member, count * steps, steps) for member in members}
            requests = [request("report", member, data) for member, data in frames.items()]
            bus.time(lambda all_=requests: [coupler.take(one) for one in all_])
            decoding.time(lambda all_=frames: [decode(data, Report) for data in all_.values()])
            main.time(lambda: coupler._books.record(coupler._books.take_complete()))
            if count % FLUSH_EVERY == FLUSH_EVERY - 1:
                flushing.time(coupler._books.flush)
        if coupler._books.recorded != rounds * steps - 1:
            raise SystemExit(f"recorded up to step {coupler._books.recorded} only")
        recorder.close("completed")
        size = path.stat().st_size
    parts = [1e3 * watch.seconds / (ranks * rounds) for watch in (bus, decoding, main, flushing)]
    total = sum(parts) - parts[1]
    shown = "".join(f"{part:10.3f}" for part in (*parts, total))
    return f"{ranks:6d}{shown}{size / 2**20:10.1f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ranks", type=int, nargs="+", default=list(RANKS))
    parser.add_argument("--steps", type=int, default=50, help="in a report")
    parser.add_argument("--rounds", type=int, default=24, help="reports of each rank")
    options = parser.parse_args()
    print("                       ms per report")
    print(" ranks       bus  decoding      main   flushes       sum  record (MiB)")
    for ranks in options.ranks:
        print(measure(ranks, options.steps, options.rounds), flush=True)


if __name__ == "__main__":
    main()
