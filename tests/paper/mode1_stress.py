"""The stress around the mode I crack at p = 0.3 (paper figures 11 to 13)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimpmd_deploy.analysis.crack import crack_of, crack_tip
from gimpmd_deploy.analysis.stress import Route, maximum_stress
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.grid.zones import Box
from tests.paper.jobs import KEEP_ALL, Job
from tests.paper.page import Result, Row, picture

COUPLED, GIMP = "mode1-p03", "mode1-p03-gimp"
KEPT, DROPPED = "mode1-p03-kept", "mode1-p03-dropped"
FIRST, LAST = 4.0 / 7.0, 1.0
"""The outputs of figures 11 and 12, t = 64 and 112, as parts of the run."""
RADIUS = 4.0
"""Radius of the averages at the crack tip: the finest cell. Points and atoms then compare."""
AROUND, DISTANCE = 40.0, 12.0
"""Half of the square around the tip; a distance ahead of it at which strain is defined."""
LIMITS = (-0.6, 0.6)
"""Colour scale of the figures: the two waves of 0.3 add up to 0.6."""
TO_FIRST = {"time.end": 64}

JOBS = [
    Job(COUPLED, "mode1"),
    Job(GIMP, "mode1", options=("--only", "continuum")),
    Job(DROPPED, "mode1", TO_FIRST | {"coupling": {"scheme": "velocity"}}),
    Job(KEPT, "mode1", TO_FIRST | {"coupling": KEEP_ALL}),
]


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Largest stresses of all runs, their differences, and figures 11 to 13."""
    coupled, gimp = runs[COUPLED], runs[GIMP]
    last = coupled.case.time.end
    first = FIRST * last
    early = {name: _largest(run, first, _middle(run)) for name, run in runs.items()}
    tip = {run: _largest(run, last, _tip(run)) for run in (gimp, coupled)}
    ahead = {
        route: _largest(coupled, last, _ahead(coupled), route) for route in ("virial", "strain")
    }
    ahead_of_gimp = _largest(gimp, last, _ahead(gimp))
    crack = crack_of(coupled)
    advance = crack_tip(coupled.atoms(last), crack).length - crack.length
    rows = [
        *(Row("11", f"largest sigma_yy away from the loaded faces, t = {first:g}: {TITLES[name]}",
              "-", f"{value:.4f}", name) for name, value in early.items()),
        Row("11", f"the same, points dropped against points kept, t = {first:g}", "not affected",
            _change(early[DROPPED], early[KEPT]), DROPPED),
        *(Row("12", f"sigma_yy at the tip, t = {last:g}: {TITLES[run.folder.name]}", "-",
              f"{value:.3f}", run.folder.name) for run, value in tip.items()),
        Row("12", f"the same, coupled against pure GIMP, t = {last:g}", "8 %",
            _change(tip[coupled], tip[gimp]), COUPLED),
        *(Row("12", f"sigma_yy {DISTANCE:g} ahead of the tip against pure GIMP ({route}), "
              f"t = {last:g}", "-", _change(value, ahead_of_gimp), COUPLED)
          for route, value in ahead.items()),
        Row("12", f"advance of the crack, t = {last:g}", "opens",
            f"{advance:.1f}", COUPLED),
        Row("5.1", "largest energy missing, over the work", "-",
            f"{coupled.energies.largest_imbalance():.1e}", COUPLED),
    ]  # fmt: skip
    figures = [
        (picture(runs[name], "sigma_yy", time, folder, LIMITS),
         f"{title}, t = {time:g} ({number}).")
        for number, time, shown in (("figure 11", first, (GIMP, COUPLED, DROPPED, KEPT)),
                                    ("figure 12", last, (GIMP, COUPLED)))
        for name, title in TITLES.items() if name in shown
    ]  # fmt: skip
    figures.append(
        (picture(coupled, "sigma_yy", last, folder, LIMITS, _corner(coupled)),
         "The lower right corner of the MD region: atoms and three levels of points (figure 13).")
    )  # fmt: skip
    return Result("Stress around the mode I crack", TEXT, rows, figures)


TITLES = {
    GIMP: "Pure GIMP",
    COUPLED: "Coupled by the force scheme",
    DROPPED: "Coupled by the velocity scheme, points deep in the MD region dropped",
    KEPT: "Coupled by the velocity scheme, all points kept",
}


def _largest(run: Run, time: float, region: Box, route: Route = "virial") -> float:
    return maximum_stress(run, "yy", time, radius=RADIUS, region=region, route=route).value


def _change(value: float, other: float) -> str:
    return f"{value / other - 1.0:+.1%}"


def _middle(run: Run) -> Box:
    """The middle half of the body: its loaded faces carry the stress of the load."""
    x, (y0, y1) = run.plan.domain.box
    return x, (0.75 * y0 + 0.25 * y1, 0.25 * y0 + 0.75 * y1)


def _tip(run: Run) -> Box:
    """Around the tip of the crack, as it was at the start."""
    (x, y) = run.plan.continuum.cracks[0].end
    return (x - AROUND, x + AROUND), (y - AROUND, y + AROUND)


def _ahead(run: Run) -> Box:
    """Ahead of the tip, where no cell of the grid reaches the faces of the crack."""
    (x, y) = run.plan.continuum.cracks[0].end
    return (x + DISTANCE, x + AROUND), (y - AROUND, y + AROUND)


def _corner(run: Run) -> Box:
    """A window around the lower right corner of the MD region that shows the levels."""
    (_, x1), (y0, _) = run.plan.atoms.region
    reach = 0.3 * (run.plan.atoms.region[1][1] - y0)
    return ((x1 - reach, x1 + 1.5 * reach), (y0 - 1.5 * reach, y0 + reach))


TEXT = """
"""
