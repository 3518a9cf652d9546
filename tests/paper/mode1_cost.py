"""Cost of the mode I crack: dropped material points, and the temporal factor N (paper 5.1)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.results.run import Run
from tests.paper.jobs import KEEP_ALL, Job
from tests.paper.page import Result, Row

STEPS = 50
"""Coupling steps of a run, at least; short ones (N = 1) take more, to be measured as well."""
LEAST = 0.4
"""Least end of a run."""
WARM_UP = 5
"""Coupling steps that are not counted: memory is first touched, kernels are loaded."""
FACTORS = (1, 10, 20, 40)
VARIANTS: dict[str, dict[str, Any]] = {"velocity": {"scheme": "velocity"}, "kept": KEEP_ALL}


def _job(n: int, variant: str | None = None) -> Job:
    """A run with temporal factor ``n``, long enough for its cost per step."""
    end = max(LEAST, STEPS * n * 0.002)
    changes = {"time.end": end, "output.interval": end, "time.md_steps": n}
    if variant is None:
        return Job(f"mode1-n{n}", "mode1", changes)
    return Job(f"mode1-n{n}-{variant}", "mode1", changes | {"coupling": VARIANTS[variant]})


JOBS = [
    *(_job(n) for n in FACTORS),
    *(_job(n, variant) for n in (1, 40) for variant in VARIANTS),
]


def seconds_per_md_step(run: Run) -> float:
    """Wall time of an MD step: median over the steps of the coarsest level, from the MD ranks."""
    phases = np.sum(list(run.timings.phases["md"].values()), axis=0)
    together = 2 ** (len(run.plan.level_boxes) - 1)
    counted = phases[WARM_UP : WARM_UP + (len(phases) - WARM_UP) // together * together]
    blocks = counted.reshape(-1, together).mean(axis=1)
    return float(np.median(blocks)) / run.plan.atoms.steps


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Rows of the costs."""
    cost = {name: seconds_per_md_step(run) for name, run in runs.items()}

    def saved(name: str, other: str) -> str:
        return f"{1.0 - cost[name] / cost[other]:.0%}"

    rows = [
        Row("5.1", f"wall time of an MD step, N = {n} (ms)", "-", f"{1e3 * cost[name]:.1f}", name)
        for n, name in ((n, f"mode1-n{n}") for n in FACTORS)
    ]
    rows.append(
        Row("5.1", "time saved by N = 40 against N = 1", "75 %", saved("mode1-n40", "mode1-n1"),
            "mode1-n40")
    )  # fmt: skip
    rows += [
        Row("5.1, 11 (c)", f"time saved by dropping points deep in the MD region, N = {n}", "50 %",
            saved(f"mode1-n{n}-velocity", f"mode1-n{n}-kept"), f"mode1-n{n}-velocity")
        for n in (1, 40)
    ]  # fmt: skip
    return Result("Cost of the mode I crack", TEXT, rows)


TEXT = """
Wall times of an MD step, waiting included, with two MD ranks and one GIMP rank on two cores:
medians over the steps of the coarsest level. The force scheme never has points among the atoms.
What they cost is therefore measured with the velocity scheme, whose inner zone holds points that
follow the atoms. The paper does not say at which N it dropped them.

From N = 10 on, the atoms take nearly all of the time, so larger N save no more, and neither do
dropped points. The savings are less than the paper's because a step of our continuum costs less in
relation to a step of the atoms: 40 ms against 25 ms at N = 1.
"""
