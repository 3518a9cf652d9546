"""A small participant in a process of its own: ``python fake.py OPTIONS`` (see ``main``).

At each node and step it offers values that no other node or step has, and it checks the values
that come back. It prints one JSON object per line.
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
from gimpmd_schemas.case.plan import Plan, load_plan
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.fields import Field, sent_fields
from gimpmd_schemas.wire.findings import Finding, check

MD_NODES, CONTINUUM_NODES = np.arange(0, 60), np.arange(100, 140)


def value(role: str, field: Field, nodes: np.ndarray, step: int, dim: int) -> np.ndarray:
    """Values of a role on its nodes at a step; no two are equal."""
    base = nodes * 1e3 + step + {"mass": 0.25, "velocity": 0.75}[field.name]
    sign = 1.0 if role == "md" else -1.0
    columns = [sign * base + 0.125 * axis for axis in range(dim)]
    return columns[0] if field.rank == 0 else np.stack(columns, axis=1)


def energies(step: int, dim: int, gain: float) -> Energies:
    """Energies of this rank at a step; the body loses some, unless this rank gains some."""
    return Energies(
        kinetic=1.0 + gain,
        potential=0.5 * step,
        external_work=0.75 * step,
        interface_work=0.0,
        dissipated=0.0,
        mass=1.0,
        momentum=tuple(step + 0.5 * axis for axis in range(dim)),
    )


def findings(options: argparse.Namespace, step: int) -> tuple[Finding, ...]:
    """One broken bond from a step on, if the options give one."""
    if not 0 <= options.break_at <= step:
        return ()
    return check("broken bond", 1.5, 1.25, (10.0, 20.0 + options.rank))


def fields_of(plan: Plan, role: str) -> tuple[Field, ...]:
    """Fields that a role sends."""
    return sent_fields(role, plan.coupling.scheme) if plan.coupling else ()


def layout(role: str, rank: int, ranks: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes offered and needed: interleaved among ranks, and needed in reverse order."""
    own, other = (MD_NODES, CONTINUUM_NODES) if role == "md" else (CONTINUUM_NODES, MD_NODES)
    return own[rank::ranks].copy(), other[::-1][rank // 2 :].copy()


def work(die: bool) -> None:
    """Work that no other rank waits for."""
    if die:
        os.kill(os.getpid(), signal.SIGKILL)


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--run-dir", type=Path, required=True)
    parser.add_argument("--run", default="test")
    parser.add_argument("--connect", required=True)
    parser.add_argument("--keys", type=Path, default=None)
    parser.add_argument("--role", required=True)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--pause", type=float, default=0.0, help="seconds of work per step")
    parser.add_argument("--sleep-at", type=int, default=-1, help="step at which to fall silent")
    parser.add_argument("--raise-at", type=int, default=-1, help="step at which to fail")
    parser.add_argument("--skip-at", type=int, default=-1, help="step to leave out")
    parser.add_argument("--die-after-part", type=int, default=-1, help="step at which to die")
    parser.add_argument("--nan-at", type=int, default=-1, help="step at which to blow up")
    parser.add_argument("--shift-at", type=int, default=-1, help="step from which masses differ")
    parser.add_argument("--break-at", type=int, default=-1, help="step at which a bond breaks")
    parser.add_argument("--gain-at", type=int, default=-1, help="step from which energy is gained")
    parser.add_argument("--change", default="{}", help="JSON of keys of the plan to replace")
    parser.add_argument("--needs", type=int, default=None, help="a node to need besides")
    options = parser.parse_args()
    plan = load_plan(options.run_dir / "plan.yaml")
    ranks = plan.ranks(options.role)
    plan = msgspec.structs.replace(plan, **json.loads(options.change))
    other = "continuum" if options.role == "md" else "md"
    try:
        with Participant(
            keys=options.keys,
            endpoint=options.connect,
            run=options.run,
            plan=plan,
            role=options.role,
            rank=options.rank,
            ranks=ranks,
            backend="fake",
            patch=plan.domain.box,
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
                    field.name: value(options.role, field, offers, step, plan.dim)
                    for field in fields_of(plan, options.role)
                }
                if step == options.nan_at:
                    fields["velocity"][0] = np.nan
                if 0 <= options.shift_at <= step:
                    fields["mass"] += 0.125
                skip = step == options.skip_at
                incoming = participant.exchange(
                    step + skip,
                    (step + skip) * plan.step,
                    fields,
                    partial(work, step == options.die_after_part),
                )
                gain = 40.0 if 0 <= options.gain_at <= step else 0.0
                known = energies(step, plan.dim, gain)
                participant.report(known, {"work": 0.5}, findings(options, step))
                if incoming.directive == "stop":
                    break
                source = step + 1 if options.role == "md" else step
                for field in fields_of(plan, other):
                    expected = value(other, field, needs, source, plan.dim)
                    if not np.array_equal(incoming.fields[field.name], expected):
                        say(wrong=field.name, step=step)
                        return 1
                step += 1
        say(ended=step)
    except GimpmdError as error:
        say(error=type(error).__name__, message=str(error), time=time.time())
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
