"""The stress around the mode I crack at p = 0.3 (paper figures 11 to 13)."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gimpmd_deploy.analysis.crack import crack_of, crack_tip
from gimpmd_deploy.analysis.resistance import crack_resistance
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
STEPS = 1000
"""Steps in place of the ramp of the load, in the exact solution."""
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
        Row("12", f"energy release rate, t = {last:g}: J of pure GIMP; exact for a half-infinite "
            "crack; resistance", "-", f"{tip_j(gimp):.2f}; {struck(gimp, last):.2f}; "
            f"{crack_resistance(coupled):.2f}", GIMP),
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


def tip_j(run: Run) -> float:
    """J at the last output, around the tip in a run of the continuum."""
    with (run.folder / "fields" / "tips.csv").open() as file:
        return float(list(csv.DictReader(file))[-1]["J"])


def struck(run: Run, time: float) -> float:
    """Energy release rate of a half-infinite crack that two waves of tension strike.

    Freund, Dynamic Fracture Mechanics (1990), section 2.5, for the sum of both waves, with the ramp
    of the load as many small steps, in plane strain.
    """
    (load,) = run.case.boundary.parts(1, 1).values()
    c, C = run.plan.wave_speed("P"), run.plan.stiffness()
    lame, shear = C[0, 1], C[2, 2]
    nu = lame / (2.0 * (lame + shear))
    modulus = 4.0 * shear * (lame + shear) / (lame + 2.0 * shear)
    (y0, y1) = run.plan.domain.box[1]
    steps = load.ramp * (np.arange(STEPS) + 0.5) / STEPS
    since = np.maximum(time - 0.5 * (y1 - y0) / c - steps, 0.0)
    K = 2.0 * 2.0 * load.value[1] / (1.0 - nu) * np.sqrt(c * (1.0 - 2.0 * nu) / np.pi)
    return float((K * np.sqrt(since).mean()) ** 2 / modulus)


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
The largest stresses are means over a radius of 4, the finest cell, so that atoms and points can
be compared. At t = 64 the front of the wave has reached the MD region. Behind it the stress is
0.3. At the front it overshoots: by 6 % in the force scheme, whose grid corrects its dispersion by
default, and by 15 % in the other runs, whose grids do not.

At t = 112 the stress at the tip agrees with pure GIMP within 1 %, where the paper has 8 %. The
paper takes the stress of the atoms from their strain, by linear elasticity. Ahead of the tip, where
strains are about 1 %, this gives more than pure GIMP, and the virial less: the crystal softens when
it is stretched. At the tip the strain of the paper's route is not defined, because a cell of the
grid reaches across the open faces of the crack.

The crack opens, but it does not grow by t = 112: its energy release rate is then far below the
energy of the surfaces that it would make. In our runs this is also true without atoms.
"""
