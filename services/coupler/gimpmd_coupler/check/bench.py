"""Starts the service that is checked, in a run folder of its own for each group of checks."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from gimpmd_coupler.bus.stage import open_stage
from gimpmd_coupler.check.partner import Fields, Partner, names
from gimpmd_coupler.check.process import started
from gimpmd_coupler.participant import OTHER
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan, load_plan, write_plan

RUN = "check"
"""Run id of all runs of a check."""

PLAN, INPUT = "plan.yaml", "input"
FOLDERS = ("fields", "atoms", "figures", "logs")
"""Folders for output that a run folder has from the start."""


@dataclass(frozen=True)
class Bench:
    """What is checked, and how.

    Attributes
    ----------
    role : of the service.
    words : its command, with ``mpiexec`` if it has several ranks.
    strip : run folder with the plan of a body with both sides, and the input of its MD code.
    block : run folder with the plan of a free body of this side alone; None: there is none.
    out : folder for the run folders of the checks.
    deadline : how long to wait for anything that the service should do (seconds).
    may_refuse : whether the service may refuse the plans: all can do what the strip asks for.
    course : payloads of an undisturbed run by step, from the check that makes one.
    """

    role: Role
    words: Sequence[str]
    strip: Path
    block: Path | None
    out: Path
    deadline: float
    may_refuse: bool = False
    course: dict[int, Fields] = field(default_factory=dict)

    def plan(self, **changes: Any) -> Plan:
        """The plan of the coupled body, with energies as often as can be, and changes."""
        return _often(load_plan(self.strip / PLAN), **changes)

    @contextmanager
    def started(self, name: str, plan: Plan, base: Path | None = None) -> Iterator[Partner]:
        """Start the service with a plan in a new run folder, and speak with it."""
        run_dir = self.out / name
        _fill(run_dir, plan, base or self.strip)
        with self.started_again(run_dir, plan) as partner:
            yield partner

    @contextmanager
    def started_again(self, run_dir: Path, plan: Plan) -> Iterator[Partner]:
        """Start the service in a run folder that is there already."""
        other = OTHER[self.role]
        ranks = names(self.role, plan.ranks(self.role))
        peers = () if plan.only else names(other, plan.ranks(other))
        with ExitStack() as resources:
            stage = resources.enter_context(open_stage(RUN, ranks, peers))
            run = ["--run-dir", str(run_dir), "--run", RUN, "--connect", stage.endpoint]
            folder = run_dir / INPUT if self.role == "md" else run_dir
            log = run_dir / "logs" / "service.log"
            process = resources.enter_context(started([*self.words, *run], folder, log))
            yield Partner(stage, process, plan, self.role, run_dir, self.deadline)

    def free_plan(self, **changes: Any) -> Plan | None:
        """The plan of the free body, likewise; None if there is none."""
        return None if self.block is None else _often(load_plan(self.block / PLAN), **changes)


def _often(plan: Plan, **changes: Any) -> Plan:
    often = {"energies_every": plan.steps_together, "output_every": plan.steps}
    return msgspec.structs.replace(plan, **(often | {"checkpoint": None} | changes))


def _fill(run_dir: Path, plan: Plan, base: Path) -> None:
    run_dir.mkdir(parents=True)
    for name in FOLDERS:
        (run_dir / name).mkdir()
    shutil.copytree(base / INPUT, run_dir / INPUT)
    write_plan(plan, run_dir / PLAN)
