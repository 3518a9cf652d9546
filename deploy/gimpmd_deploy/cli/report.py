"""``gimpmd report``: summarise a run."""

from __future__ import annotations

from gimpmd_deploy.cli.options import Json, RunPath, print_json, standard_output


def report(run: RunPath, as_json: Json = False) -> None:
    """Show how far and how fast a run went, where the time went, and what was conserved."""
    from gimpmd_deploy.results.report import make_report
    from gimpmd_deploy.results.run import Run
    from gimpmd_deploy.results.tables import print_report

    results = Run(run)
    summary = make_report(results)
    if as_json:
        print_json(summary)
    else:
        print_report(summary, results.plan.units, standard_output())
