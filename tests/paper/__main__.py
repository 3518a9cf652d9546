"""Run the paper's problems and write docs/paper.md.

    python -m tests.paper [STUDY ...] [--runs FOLDER] [--quarter] [--list]

Without names all studies. Runs that were completed in the folder before are not repeated.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from gimpmd_deploy.results.run import Run
from tests.paper import (
    friction,
    friction_setup,
    growth_setup,
    half_size,
    mode1_cost,
    mode1_growth,
    mode1_overhead,
    mode1_stress,
    page,
)
from tests.paper.jobs import Job, finished


class Study(NamedTuple):
    """Runs, and what is measured in them: ``measure(runs, folder)``.

    ``folder`` is that of the runs; ``folder / "images"`` is where pictures go.
    """

    jobs: Sequence[Job]
    measure: Callable[[Mapping[str, Run], Path], page.Result]


STUDIES: Mapping[str, Study] = {
    "mode1-stress": Study(mode1_stress.JOBS, mode1_stress.measure),
    "mode1-growth": Study(mode1_growth.JOBS, mode1_growth.measure),
    "growth-setup": Study(growth_setup.JOBS, growth_setup.measure),
    "mode1-cost": Study(mode1_cost.JOBS, mode1_cost.measure),
    "mode1-overhead": Study((), mode1_overhead.measure),
    "half-size": Study(half_size.JOBS, half_size.measure),
    "friction": Study(friction.JOBS, friction.measure),
    "friction-setup": Study(friction_setup.JOBS, friction_setup.measure),
}
"""In the order of the page."""


QUARTER = ("mode1-stress", "mode1-growth", "mode1-cost")
"""Studies that can be tried at a quarter of the size."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.paper", description="The paper's runs")
    parser.add_argument("studies", nargs="*", choices=[[], *STUDIES], metavar="STUDY")
    parser.add_argument("--runs", type=Path, default=Path("runs/paper"), help="folder of the runs")
    parser.add_argument("--list", action="store_true", help="show the runs of each study, and end")
    parser.add_argument(
        "--quarter",
        action="store_true",
        help="try the runs of mode1 in mode1-small: minutes; the page goes to the folder of runs",
    )
    options = parser.parse_args()
    docs = options.runs if options.quarter else page.DOCS
    (options.runs / "images").mkdir(parents=True, exist_ok=True)
    if options.quarter and not set(options.studies) <= set(QUARTER):
        parser.error(f"--quarter is for {', '.join(QUARTER)}")
    for name in options.studies or (QUARTER if options.quarter else STUDIES):
        study = STUDIES[name]
        jobs = [job.quarter() for job in study.jobs] if options.quarter else study.jobs
        if options.list:
            print(name, *(f"  {job.name}: {page.changes_of(job)}" for job in jobs), sep="\n")
            continue
        runs = {job.name: finished(job, options.runs) for job in jobs}
        page.keep(docs, name, study.measure(runs, options.runs), jobs, runs)
        page.write(docs, list(STUDIES))


if __name__ == "__main__":
    main()
