"""Run the paper's problems and write docs/paper.md.

    python -m tests.paper [STUDY ...] [--runs FOLDER] [--list]

Without names all studies. Runs that were completed in the folder before are not repeated.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from gimpmd_deploy.results.run import Run
from tests.paper import mode1_cost, page
from tests.paper.jobs import Job, finished

Study = tuple[Sequence[Job], Callable[[Mapping[str, Run]], page.Result]]

STUDIES: Mapping[str, Study] = {
    "mode1-cost": (mode1_cost.JOBS, mode1_cost.measure),
}
"""In the order of the page."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.paper", description="The paper's runs")
    parser.add_argument("studies", nargs="*", choices=[[], *STUDIES], metavar="STUDY")
    parser.add_argument("--runs", type=Path, default=Path("runs/paper"), help="folder of the runs")
    parser.add_argument("--list", action="store_true", help="show the runs of each study, and end")
    options = parser.parse_args()
    for name in options.studies or STUDIES:
        jobs, measure = STUDIES[name]
        if options.list:
            print(name, *(f"  {job.name}: {page.changes_of(job)}" for job in jobs), sep="\n")
            continue
        page.keep(name, measure({job.name: finished(job, options.runs) for job in jobs}))
        page.write(list(STUDIES))


if __name__ == "__main__":
    main()
