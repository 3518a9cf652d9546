"""The stress around the mode I crack at p = 0.3 (paper figures 11 to 13)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimpmd_deploy.analysis.stress import maximum_stress
from gimpmd_deploy.results.run import Run
from tests.paper.jobs import KEEP_ALL, Job
from tests.paper.page import Result, Row, picture

COUPLED, GIMP = "mode1-p03", "mode1-p03-gimp"
KEPT, DROPPED = "mode1-p03-kept", "mode1-p03-dropped"
FIRST, LAST = 4.0 / 7.0, 1.0
"""The outputs of figures 11 and 12, t = 64 and 112, as parts of the run."""
RADIUS = 4.0
"""Radius of the averages at the crack tip: the finest cell. Points and atoms then compare."""
LIMITS = (-0.8, 0.8)
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
    last = runs[COUPLED].case.time.end
    first = FIRST * last
    rows = [_largest(runs[name], first, "11") for name in (GIMP, COUPLED, DROPPED, KEPT)]
    rows += [_largest(runs[name], LAST * last, "12") for name in (GIMP, COUPLED)]
    rows += [
        Row("11", f"difference of the largest sigma_yy from pure GIMP, t = {first:g}", "-",
            _difference(runs[COUPLED], runs[GIMP], first), COUPLED),
        Row("11", f"difference of the largest sigma_yy, points dropped and kept, t = {first:g}",
            "not affected", _difference(runs[DROPPED], runs[KEPT], first), DROPPED),
        Row("12", f"difference of the largest sigma_yy from pure GIMP, t = {last:g}", "8 %",
            _difference(runs[COUPLED], runs[GIMP], last), COUPLED),
        Row("5.1", "largest energy missing, over the work", "-",
            f"{runs[COUPLED].energies.largest_imbalance():.1e}", COUPLED),
    ]  # fmt: skip
    figures = [
        (picture(runs[name], "sigma_yy", time, folder, LIMITS), f"{title}, t = {time:g} ({number}).")
        for number, time, shown in (("figure 11", first, (GIMP, COUPLED, DROPPED, KEPT)),
                                    ("figure 12", last, (GIMP, COUPLED)))
        for name, title in TITLES.items() if name in shown
    ]  # fmt: skip
    corner = _corner(runs[COUPLED])
    figures.append(
        (picture(runs[COUPLED], "sigma_yy", last, folder, LIMITS, corner),
         "The lower right corner of the MD region: atoms and three levels of points (figure 13).")
    )  # fmt: skip
    return Result("Stress around the mode I crack", TEXT, rows, figures)


TITLES = {
    GIMP: "Pure GIMP",
    COUPLED: "Coupled by the force scheme",
    DROPPED: "Coupled by the velocity scheme, points deep in the MD region dropped",
    KEPT: "Coupled by the velocity scheme, all points kept",
}


def _largest(run: Run, time: float, figure: str) -> Row:
    found = maximum_stress(run, "yy", time, radius=RADIUS, region=_inside(run))
    where = ", ".join(f"{x:.0f}" for x in found.position)
    quantity = f"largest sigma_yy, t = {time:g}, {TITLES[run.folder.name]}"
    return Row(figure, quantity, "-", f"{found.value:.3f} at ({where})", run.folder.name)


def _difference(run: Run, other: Run, time: float) -> str:
    """Relative difference of the largest stresses, by the virial and by the grid's strain."""
    b = maximum_stress(other, "yy", time, radius=RADIUS, region=_inside(other)).value
    routes = ("virial", "strain")
    found = [
        maximum_stress(run, "yy", time, radius=RADIUS, route=route, region=_inside(run)).value
        for route in routes
    ]
    return ", ".join(f"{a / b - 1.0:+.1%} ({r})" for a, r in zip(found, routes, strict=True))


def _inside(run: Run) -> tuple[tuple[float, float], ...]:
    """The body without its loaded faces, whose atoms and points have the stress of the load."""
    (x0, x1), (y0, y1) = run.plan.domain.box
    return ((x0, x1), (0.75 * y0 + 0.25 * y1, 0.25 * y0 + 0.75 * y1))


def _corner(run: Run) -> tuple[tuple[float, float], tuple[float, float]]:
    """A window around the lower right corner of the MD region that shows the levels."""
    (_, x1), (y0, _) = run.plan.atoms.region
    reach = 0.3 * (run.plan.atoms.region[1][1] - y0)
    return ((x1 - reach, x1 + 1.5 * reach), (y0 - 1.5 * reach, y0 + reach))


TEXT = """
"""
