"""What the coupler costs over the number of ranks: ``make bench-ranks``.

The real coupler serves ranks that do no work: they exchange the nodes of an interface that is
divided evenly among the ranks of each side, as fast as they can or at a given pace. Beside it, a
Zenoh router that does nothing but hand on the same payloads on the same way.

Columns: ranks of both sides; payload of an MD rank; frames with payloads that the router takes and
hands on in a step; processor time of the coupler's process and of the bare router in a step; what
the coupler adds to the router for each frame; wall time of a step with each of them.

The ranks are threads of a few processes, because hundreds of processes would not fit on a small
machine. The coupler sees no difference: each rank has a connection of its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec
import numpy as np
import zenoh

from gimpmd_coupler.bus import settings
from gimpmd_coupler.bus.hub import listen
from gimpmd_coupler.participant import OFFSET, OTHER, Participant
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import Plan, load_plan, make_plan, write_plan
from gimpmd_schemas.wire.energies import Energies

RANKS = (2, 4, 8, 16, 32, 64, 128, 256)
NODES = {2: 64, 3: 1000}
"""Nodes of the interface of an MD rank, whose masses and velocities it sends."""

MOST_SECONDS = 2.0  # hub time per step at 64 ranks, in ms, that must not be exceeded
LIMIT_RANKS = 64
PROCESSES = 4
WARM_SECONDS = 1.5  # kernels of numpy, first payloads, the pace of the grants
TIMINGS = dict.fromkeys(("zone_fields", "finish", "output", "receive", "advance"), 1e-3)


@dataclass(frozen=True)
class Setting:
    """One measurement: how many ranks, how many axes, seconds of a step if they do not hurry."""

    ranks: int
    dim: int
    pace: float

    @property
    def md(self) -> int:
        """Ranks of the MD side: four of five."""
        return max(1, 4 * self.ranks // 5)

    def count(self, role: str) -> int:
        return self.md if role == "md" else self.ranks - self.md

    def nodes(self, role: str, rank: int) -> np.ndarray:
        """Nodes of a rank: its share of the interface."""
        every = np.arange(NODES[self.dim] * self.md)
        return np.array_split(every, self.count(role))[rank]

    def sources(self, role: str, rank: int) -> list[int]:
        """Ranks of the other side with which a rank shares nodes."""
        mine, other = self.nodes(role, rank), OTHER[role]
        return [
            k for k in range(self.count(other)) if np.intersect1d(self.nodes(other, k), mine).size
        ]

    def frames(self) -> int:
        """Frames that the router takes and hands on in a step."""
        members = [(role, k) for role in OTHER for k in range(self.count(role))]
        return len(members) + sum(len(self.sources(*member)) for member in members)

    def case(self) -> Case:
        """A case with so many ranks that would last for ever."""
        width = 4000
        box = [[0, width]] + (self.dim - 1) * [[0, 80]]
        region = [[0, width // 2]] + (self.dim - 1) * [[20, 60]]
        plain = {
            "gimpmd": 1,
            "name": "bench",
            "units": "lj",
            "domain": {"box": box},
            "grid": {"cell": 4},
            "time": {"end": 0.08 * 10**7, "md_timestep": 0.002, "md_steps": 40},
            "md": {"region": region, "input": "md.in", "ranks": self.md},
            "coupling": {"scheme": "velocity"},
            "continuum": {
                "material": {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8},
                "ranks": self.ranks - self.md,
            },
            "output": {"interval": 1},
        }
        return msgspec.convert(plain, Case)


class Clock:
    """Tells the parent how far the ranks are, several times a second, and keeps the pace."""

    def __init__(self, pace: float, leads: bool) -> None:
        self._pace, self._leads = pace, leads
        self._start = self._said = time.monotonic()

    def tick(self, step: int) -> None:
        now = time.monotonic()
        if self._leads and now > self._said + 0.1:
            self._said = now
            print(json.dumps({"step": step}), flush=True)
        time.sleep(max(self._start + self._pace * step - now, 0.0))


def take_part(setting: Setting, role: str, rank: int, plan: Plan, endpoint: str) -> None:
    """One rank of the coupler's run."""
    nodes = setting.nodes(role, rank)
    fields = {"velocity": np.ones((nodes.size, setting.dim))}
    if role == "md":
        fields["mass"] = np.ones(nodes.size)
    energies = Energies(
        kinetic=1.0,
        potential=1.0,
        external_work=1.0,
        interface_work=1.0,
        dissipated=1.0,
        mass=1.0,
        momentum=(1.0,) * setting.dim,
    )
    with Participant(
        endpoint=endpoint,
        run="bench",
        plan=plan,
        role=role,
        rank=rank,
        ranks=setting.count(role),
        backend="bench",
        patch=plan.domain.box,
    ) as side:
        step = side.register(offers=nodes, needs=nodes).first_step
        clock = Clock(setting.pace, (role, rank) == ("md", 0))
        while True:
            side.exchange(step, plan.step * step, fields)
            side.report(energies if step % 10 == 0 else None, TIMINGS)
            step += 1
            clock.tick(step)


def play_raw(setting: Setting, role: str, rank: int, endpoint: str) -> None:
    """One rank that exchanges the same payloads and does nothing else."""
    width = setting.dim + (role == "md")
    frame = np.ones(setting.nodes(role, rank).size * width).tobytes()
    inbox: SimpleQueue[tuple[int, int]] = SimpleQueue()

    def take(sample: zenoh.Sample) -> None:
        number = int.from_bytes(sample.attachment.to_bytes(), "little")
        inbox.put((int(str(sample.key_expr).rsplit("/", 1)[1]), number))

    sources = setting.sources(role, rank)
    with zenoh.open(settings.config("client", endpoint)) as session, ExitStack() as held:
        for k in sources:
            key = f"data/{OTHER[role]}/{k}"
            subscriber = session.declare_subscriber(key, settings.direct(take))
            held.callback(subscriber.undeclare)
        publisher = session.declare_publisher(f"data/{role}/{rank}", **settings.AT_ONCE)
        print(json.dumps({"ready": [role, rank]}), flush=True)
        GO.wait()
        clock, here = Clock(setting.pace, (role, rank) == ("md", 0)), set()
        step = 0
        while True:
            publisher.put(frame, attachment=step.to_bytes(8, "little"))
            wanted = {(k, step + OFFSET[role]) for k in sources}
            while not wanted <= here:
                here.add(inbox.get())
            here -= wanted
            step += 1
            clock.tick(step)


GO = threading.Event()
"""Set when all ranks without a coupler have subscribed."""


def host(setting: Setting, members: list[tuple[str, int]], run_dir: str, endpoint: str) -> None:
    """Be some of the ranks until standard input ends."""
    settings.tune_process("client")
    act: Any = play_raw
    if run_dir:
        act = partial(take_part, plan=load_plan(Path(run_dir) / "plan.yaml"))
    for role, rank in members:
        kwargs = {"setting": setting, "role": role, "rank": rank, "endpoint": endpoint}
        threading.Thread(target=act, kwargs=kwargs, daemon=True).start()
    sys.stdin.readline()
    GO.set()
    sys.stdin.read()


def bare_router() -> None:
    """A router that hands payloads on."""
    with listen() as (_, endpoint):
        print(json.dumps({"endpoint": endpoint}), flush=True)
        sys.stdin.read()


@contextmanager
def process(*command: str) -> Iterator[subprocess.Popen[str]]:
    """A process that ends with the block."""
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def processor_time(pid: int) -> float:
    """Seconds that all threads of a process have run so far."""
    stats = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return 1e-9 * sum(int(stat.read_text().split()[0]) for stat in stats)


@dataclass(frozen=True)
class Cost:
    """Milliseconds of a step: processor time of the router's process, and wall time."""

    hub: float
    wall: float


def measure(setting: Setting, seconds: float, coupled: bool) -> Cost:
    """Let the ranks run for some seconds, with the coupler or with the bare router."""
    here = (sys.executable, "-m", "tests.benchmarks.bench_ranks")
    members = [(role, k) for role in OTHER for k in range(setting.count(role))]
    shares = [members[k::PROCESSES] for k in range(min(PROCESSES, len(members)))]
    with tempfile.TemporaryDirectory(prefix="bench-ranks-") as folder, ExitStack() as held:
        if coupled:
            case = setting.case()
            dump_case(case, Path(folder) / "case.yaml")
            write_plan(make_plan(case), Path(folder) / "plan.yaml")
            start = ("-m", "gimpmd_coupler.service", "--run-dir", folder, "--run", "bench")
            hub = held.enter_context(process(sys.executable, *start))
        else:
            hub = held.enter_context(process(*here, "router"))
        endpoint = json.loads(hub.stdout.readline())["endpoint"]
        drain(hub)
        what = json.dumps(vars(setting))
        hosts = [
            held.enter_context(
                process(*here, "host", what, json.dumps(share), folder * coupled, endpoint)
            )
            for share in shares
        ]
        if not coupled:
            for child, share in zip(hosts, shares, strict=True):
                for _ in share:
                    child.stdout.readline()
            time.sleep(0.5)  # until the router knows all subscriptions
        for child in hosts:
            child.stdin.write("go\n")
            child.stdin.flush()
        leader = hosts[0].stdout
        for child in hosts:
            threading.Thread(target=end_together, args=(child, hosts), daemon=True).start()
        began = None
        while True:
            if not (text := leader.readline()):
                raise SystemExit(f"ranks ended: {[child.wait() for child in hosts]}")
            line = json.loads(text)
            now, used = time.monotonic(), processor_time(hub.pid)
            began = began or now
            if now < began + WARM_SECONDS:
                first = (line["step"], now, used)
            elif now > began + WARM_SECONDS + seconds:
                steps = line["step"] - first[0]
                return Cost(1e3 * (used - first[2]) / steps, 1e3 * (now - first[1]) / steps)


def end_together(child: subprocess.Popen[str], others: list[subprocess.Popen[str]]) -> None:
    """End all processes once one has ended."""
    child.wait()
    for other in others:
        other.kill()


def drain(child: subprocess.Popen[str]) -> None:
    """Read what a process prints, so that it never waits for us."""
    threading.Thread(target=child.stdout.read, daemon=True).start()


def compare(setting: Setting, seconds: float, runs: int) -> tuple[Cost, Cost]:
    """Coupler and bare router in turn; the medians."""
    costs = [[measure(setting, seconds, coupled) for coupled in (True, False)] for _ in range(runs)]
    return tuple(
        Cost(*np.median([(pair[k].hub, pair[k].wall) for pair in costs], axis=0)) for k in (0, 1)
    )


def main() -> int:
    """Print the table; 1 if the coupler takes more than the limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ranks", type=int, nargs="+", default=list(RANKS))
    parser.add_argument("--dims", type=int, nargs="+", default=list(NODES))
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    parser.add_argument("--runs", type=int, default=3, help="of which the medians are shown")
    parser.add_argument("--pace", type=float, default=0.0, help="seconds of a step, at least")
    parser.add_argument("part", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args()
    match options.part:
        case ["router"]:
            bare_router()
            return 0
        case ["host", what, share, run_dir, endpoint]:
            host(Setting(**json.loads(what)), json.loads(share), run_dir, endpoint)
            return 0
    print("                                hub, ms per step            wall, ms per step")
    print(" ranks  payload  frames   coupler  bare router  us/frame   coupler  bare router")
    failed = False
    for dim in options.dims:
        for ranks in options.ranks:
            setting = Setting(ranks, dim, options.pace)
            ours, bare = compare(setting, options.seconds, options.runs)
            failed |= ranks == LIMIT_RANKS and ours.hub > MOST_SECONDS
            print(
                f"{ranks:6d}  {8 * (dim + 1) * NODES[dim] / 1024:4.0f} KB  {setting.frames():6d}"
                f"  {ours.hub:8.2f}  {bare.hub:11.2f}"
                f"  {1e3 * (ours.hub - bare.hub) / setting.frames():8.1f}"
                f"  {ours.wall:8.2f}  {bare.wall:11.2f}",
                flush=True,
            )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
