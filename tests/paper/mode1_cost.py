"""Cost of the mode I crack: dropped material points, and the temporal factor N (paper 5.1)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimpmd_deploy.results.run import Run
from tests.paper.jobs import Job
from tests.paper.page import Result, Row, runs_of

END = 4.0
"""Until here every temporal factor has taken 50 coupling steps or more."""
KEEP_ALL = 296.0
"""Width of an inner zone that reaches the middle of the MD region: no point is dropped."""
WARM_UP = 5
"""Coupling steps that are not counted: memory is first touched, kernels are loaded."""

SHORT = {"time.end": END, "output.interval": END}
FACTORS = (1, 10, 20, 40)

JOBS = [
    *(Job(f"mode1-n{n}", "mode1", SHORT | {"time.md_steps": n}) for n in FACTORS),
    *(
        Job(f"mode1-n{n}-velocity", "mode1", SHORT | {"time.md_steps": n, "coupling": coupling})
        for n in (1, 40)
        for coupling in ({"scheme": "velocity"},)
    ),
    *(
        Job(f"mode1-n{n}-kept", "mode1", SHORT | {"time.md_steps": n, "coupling": coupling})
        for n in (1, 40)
        for coupling in ({"scheme": "velocity", "zones": {"inner": KEEP_ALL}},)
    ),
]


def seconds_per_md_step(run: Run) -> float:
    """Median wall time of a coupling step, from the phases of the MD ranks, over N."""
    phases = run.timings.phases["md"].values()
    return float(np.median(np.sum(list(phases), axis=0)[WARM_UP:])) / run.plan.atoms.steps


def measure(runs: Mapping[str, Run]) -> Result:
    """Rows of the costs."""
    cost = {name: seconds_per_md_step(run) for name, run in runs.items()}
    rows = []
    for n in FACTORS:
        rows.append(
            Row("5.1", f"ms per MD step, N = {n}", "-", f"{1e3 * cost[f'mode1-n{n}']:.1f}", f"mode1-n{n}")
        )
    saved = 1.0 - cost["mode1-n40"] / cost["mode1-n1"]
    rows.append(Row("5.1", "time saved by N = 40 against N = 1", "75 %", f"{saved:.0%}", "mode1-n40"))
    for n in (1, 40):
        kept, dropped = cost[f"mode1-n{n}-kept"], cost[f"mode1-n{n}-velocity"]
        rows.append(
            Row(
                "5.1, 11 (c)",
                f"time saved by dropping points deep in the MD region, N = {n}",
                "50 %",
                f"{1.0 - dropped / kept:.0%}",
                f"mode1-n{n}-velocity",
            )
        )
    return Result("Cost of the mode I crack", TEXT, rows, runs_of(JOBS, runs))


TEXT = """
Wall time of an MD step is the median over the coupling steps, waiting included, on the same two MD
ranks and one GIMP rank. The force scheme never has points among the atoms; the paper's comparison
is therefore made with the velocity scheme, whose inner zone holds the points that follow the atoms.
"""
