"""A small participant in a process of its own: ``python fake.py OPTIONS`` (see ``main``).

It offers, on node n at step k, values that only that node and step have, and checks what comes
back. Prints one JSON object a line.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from gimpmd_coupler.participant import Participant
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.messages import SCHEME_FIELDS

SHAPES = {"mass": (), "velocity": (2,)}
MD_NODES, CONTINUUM_NODES = np.arange(0, 60), np.arange(100, 140)


def value(role: str, field: str, nodes: np.ndarray, step: int) -> np.ndarray:
    """What a role says of its nodes at a step; no two are alike."""
    base = nodes * 1e3 + step + {"mass": 0.25, "velocity": 0.75}[field]
    sign = 1.0 if role == "md" else -1.0
    columns = [sign * base, sign * base + 0.125]
    return columns[0] if SHAPES[field] == () else np.stack(columns, axis=1)


def layout(role: str, rank: int, ranks: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes offered and needed: interleaved among ranks, and needed in reverse order."""
    own, other = (MD_NODES, CONTINUUM_NODES) if role == "md" else (CONTINUUM_NODES, MD_NODES)
    return own[rank::ranks].copy(), other[::-1][rank // 2 :].copy()


def work(die: bool) -> None:
    """What nobody waits for."""
    if die:
        os.kill(os.getpid(), signal.SIGKILL)


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--run-dir", type=Path, required=True)
    parser.add_argument("--run", default="test")
    parser.add_argument("--connect", required=True)
    parser.add_argument("--role", required=True)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--pause", type=float, default=0.0, help="seconds of work per step")
    parser.add_argument("--sleep-at", type=int, default=-1, help="step at which to fall silent")
    parser.add_argument("--raise-at", type=int, default=-1, help="step at which to fail")
    parser.add_argument("--skip-at", type=int, default=-1, help="step to leave out")
    parser.add_argument("--die-at-the-books", type=int, default=-1, help="of this step")
    parser.add_argument("--nan-at", type=int, default=-1, help="step at which to blow up")
    parser.add_argument("--change", default="{}", help="JSON of keys of the case to replace")
    parser.add_argument("--needs", type=int, default=None, help="a node to need besides")
    options = parser.parse_args()
    case = load_case(options.run_dir / "case.yaml")
    ranks = case.ranks(options.role)
    raw = msgspec.to_builtins(case) | json.loads(options.change)
    case = msgspec.convert(raw, type(case))
    other = "continuum" if options.role == "md" else "md"
    try:
        with Participant(
            endpoint=options.connect,
            run=options.run,
            case=case,
            role=options.role,
            rank=options.rank,
            ranks=ranks,
            backend="fake",
            patch=case.domain.box,
        ) as participant:
            offers, needs = layout(options.role, options.rank, ranks)
            if options.needs is not None:
                needs = np.append(needs, options.needs)
            accepted = participant.register(offers=offers, needs=needs)
            say(accepted=[accepted.first_step, accepted.last_step], pid=os.getpid())
            step = accepted.first_step
            while True:
                time.sleep(3600 if step == options.sleep_at else options.pause)
                if step == options.raise_at:
                    raise RuntimeError("lost my marbles")
                fields = {
                    field: value(options.role, field, offers, step)
                    for field in SCHEME_FIELDS["velocity"][options.role]
                }
                if step == options.nan_at:
                    fields["velocity"][0] = np.nan
                energies = {"kinetic": 1.0, "potential": 0.5 * step, "external_work": 0.25 * step}
                skip = step == options.skip_at
                incoming = participant.exchange(
                    step + skip,
                    (step + skip) * case.step(),
                    fields,
                    partial(work, step == options.die_at_the_books),
                )
                participant.account(energies, {"work": 0.5})
                if incoming.directive == "stop":
                    break
                source = step + 1 if options.role == "md" else step
                for field in SCHEME_FIELDS["velocity"][other] if not case.only else ():
                    expected = value(other, field, needs, source)
                    if not np.array_equal(incoming.fields[field], expected):
                        say(wrong=field, step=step)
                        return 1
                step += 1
        say(ended=step)
    except GimpmdError as error:
        say(error=type(error).__name__, message=str(error), time=time.time())
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
