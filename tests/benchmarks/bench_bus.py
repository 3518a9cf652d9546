"""Round trip of a coupling step, MD -> continuum -> MD: ``bench_bus.py``.

The real coupler and two participants, each a process, beside raw Zenoh publications that take the
same way through a Python hub and back, in one run and in alternating batches. The figures of
MUSCLE3 are quoted: they were measured earlier on a machine busy with other work and are no fair
match for a run on a quiet one, where MUSCLE3 takes less than half of them.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
import zenoh

from gimpmd_coupler.bus.connection import enter
from gimpmd_coupler.bus.hub import listen
from gimpmd_coupler.bus.settings import AT_ONCE, direct
from gimpmd_coupler.participant import Participant
from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import load_plan, make_plan, write_plan
from gimpmd_schemas.wire.access import KEYS, TLS
from gimpmd_schemas.wire.energies import Energies

SIZES = (2 * 2**10, 32 * 2**10, 256 * 2**10)
MUSCLE3 = {SIZES[0]: 0.97, SIZES[1]: 1.05, SIZES[2]: 2.96}
"""MUSCLE3 0.11, two Python processes, direct, round trip in ms, measured earlier under load."""

THERE, HERE = "gimpmd/bench/report/md/0", "gimpmd/bench/answer/md/0"
BACK, ECHO = "gimpmd/bench/report/continuum/0", "gimpmd/bench/answer/continuum/0"
"""Keys of the raw publications: from and to each side."""

BATCH, WARM = 20, 3000
"""Steps of a batch, and steps that do not count: at first the coupler does not know the pace of
the run, so its grants reach ahead by two steps only, and ranks report at every step."""
ENERGIES = Energies(
    kinetic=1.0,
    potential=1.0,
    external_work=1.0,
    interface_work=1.0,
    dissipated=1.0,
    mass=1.0,
    momentum=(1.0, 1.0),
)


def case_of(rounds: int, record: bool) -> Case:
    """A case with one rank a side and the wanted number of steps."""
    plain = {
        "gimpmd": 1,
        "name": "bench",
        "units": "lj",
        "domain": {"box": [[0, 120], [0, 80]]},
        "grid": {"cell": 4},
        "time": {"end": 0.08 * rounds, "md_timestep": 0.002, "md_steps": 40},
        "md": {"region": [[0, 80], [20, 60]], "input": "md.in"},
        "coupling": {"scheme": "velocity"},
        "continuum": {
            "material": {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8},
        },
        "output": {"interval": 1},
        "record": record,
    }
    return msgspec.convert(plain, Case)


def nodes(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the MD side (three numbers each) and of the continuum (two) that fill a payload."""
    return np.arange(size // 24), 100_000 + np.arange(size // 16)


def place(run_dir: Path, tls: bool) -> str:
    """Endpoint for a router: with TLS and keys in the run folder, or none for a socket."""
    if not tls:
        return ""
    if not (run_dir / KEYS).exists():
        new_keys(run_dir / KEYS, ["127.0.0.1"])
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"{TLS}/127.0.0.1:{server.getsockname()[1]}"


def participant(run_dir: Path, endpoint: str, role: str) -> Participant:
    plan = load_plan(run_dir / "plan.yaml")
    return Participant(
        keys=run_dir / KEYS,
        endpoint=endpoint,
        run="bench",
        plan=plan,
        role=role,
        rank=0,
        ranks=1,
        backend="bench",
        patch=plan.domain.box,
    )


def md_fields(size: int) -> dict[str, np.ndarray]:
    ids = nodes(size)[0]
    return {
        "mass": np.ones(ids.size),
        "velocity": np.ones((ids.size, 2)),
    }


def continuum(run_dir: Path, endpoint: str, size: int) -> None:
    """The other side: answers at once."""
    theirs, ours = nodes(size)
    fields = {"velocity": np.ones((ours.size, 2))}
    with participant(run_dir, endpoint, "continuum") as side:
        step = side.register(offers=ours, needs=theirs).first_step
        while side.exchange(step, 0.08 * step, fields).directive == "advance":
            side.report(ENERGIES, {})
            step += 1
        side.report(ENERGIES, {})


def raw_hub(endpoint: str, keys: Path) -> None:
    """A hub in Python that hands frames on, on keys that both sides may use."""
    ways = {THERE: ECHO, BACK: HERE}

    def hand_on(sample: zenoh.Sample) -> None:
        session.put(ways[str(sample.key_expr)], sample.payload.to_bytes(), **AT_ONCE)

    with listen(endpoint, "bench", keys) as (session, where):
        held = [session.declare_subscriber(key, direct(hand_on)) for key in ways]
        print(where, flush=True)
        sys.stdin.read()
        for subscriber in held:
            subscriber.undeclare()


def raw_echo(endpoint: str, keys: Path) -> None:
    """The far end."""
    with enter(endpoint, "continuum", 0, keys) as session:
        publisher = session.declare_publisher(BACK, **AT_ONCE)
        asked = session.declare_subscriber(ECHO)
        for sample in asked.handler:
            publisher.put(np.frombuffer(sample.payload.to_bytes()).tobytes())


@contextmanager
def process(*command: str) -> Iterator[subprocess.Popen[str]]:
    """A process of this file, or another command, that ends with the block."""
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def measure(size: int, rounds: int, tls: bool, record: bool) -> dict[str, np.ndarray]:
    """Round trips in ms, by way."""
    here = (sys.executable, __file__)
    theirs_md, theirs_continuum = nodes(size)
    times: dict[str, list[float]] = {"gimpmd": [], "raw zenoh": []}
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder)
        case = case_of(rounds + WARM + BATCH, record)
        dump_case(case, run_dir / "case.yaml")
        write_plan(make_plan(case), run_dir / "plan.yaml")
        start = ("-m", "gimpmd_coupler.service", "--run-dir", folder, "--run", "bench")
        ours, raws, keys = place(run_dir, tls), place(run_dir, tls), run_dir / KEYS
        with (
            process(sys.executable, *start, "--listen", ours) as coupler,
            process(*here, "raw-hub", raws, str(keys)) as hub,
        ):
            endpoint = json.loads(coupler.stdout.readline())["endpoint"]
            raw = hub.stdout.readline().strip()
            with (
                process(*here, "continuum", folder, endpoint, str(size)),
                process(*here, "raw-echo", raw, str(keys)),
                participant(run_dir, endpoint, "md") as md,
                enter(raw, "md", 0, keys) as session,
            ):
                publisher = session.declare_publisher(THERE, **AT_ONCE)
                answers = session.declare_subscriber(HERE)
                md.register(offers=theirs_md, needs=theirs_continuum)
                fields, payload = md_fields(size), np.ones(size // 8)
                deadline = time.monotonic() + 10.0
                while answers.handler.try_recv() is None:
                    if time.monotonic() > deadline:
                        raise SystemExit("raw Zenoh: nothing comes back within 10 s")
                    publisher.put(b"")
                    time.sleep(0.05)
                time.sleep(0.2)
                while answers.handler.try_recv() is not None:
                    pass
                step = 0
                while step < rounds + WARM:
                    for _ in range(BATCH):
                        start_time = time.perf_counter()
                        md.exchange(step, 0.08 * step, fields)
                        times["gimpmd"].append(time.perf_counter() - start_time)
                        md.report(ENERGIES, {})
                        step += 1
                    for _ in range(BATCH):
                        start_time = time.perf_counter()
                        publisher.put(payload.tobytes())
                        np.frombuffer(answers.handler.recv().payload.to_bytes())
                        times["raw zenoh"].append(time.perf_counter() - start_time)
    return {way: 1e3 * np.array(seconds[WARM:]) for way, seconds in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=600)
    parser.add_argument("--tls", action="store_true", help="as between hosts")
    parser.add_argument("--record", action="store_true", help="the run is recorded")
    parser.add_argument("part", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args()
    match options.part:
        case ["raw-hub", endpoint, keys]:
            raw_hub(endpoint, Path(keys))
        case ["raw-echo", endpoint, keys]:
            raw_echo(endpoint, Path(keys))
        case ["continuum", folder, endpoint, size]:
            continuum(Path(folder), endpoint, int(size))
        case _:
            print(f"{'payload':>8}  {'way':<22} {'median':>8} {'p90':>8}   (ms, round trip)")
            for size in SIZES:
                for way, ms in measure(size, options.rounds, options.tls, options.record).items():
                    median, p90 = np.percentile(ms, (50, 90))
                    print(f"{size >> 10:>5} KB  {way:<22} {median:8.2f} {p90:8.2f}", flush=True)
                print(f"{size >> 10:>5} KB  {'MUSCLE3 (quoted, busy)':<22} {MUSCLE3[size]:8.2f}")


if __name__ == "__main__":
    main()
