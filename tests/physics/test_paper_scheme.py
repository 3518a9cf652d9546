"""The coupling as published: what it passes, and that it is unstable without damping.

R and T are held to those of the independent prototype in one process (lumped projection,
velocities sampled at the sync, MUSL, zones 4, 8, 8) on the same strip, run for this comparison.
"""

from __future__ import annotations

import numpy as np
import pytest
from strips import broadband_case, energies, run_case, strip_case

ZONES = {"outer": 4.0, "incommunicado": 8.0, "inner": 8.0}
UNDAMPED = {"every": 0}

PROTOTYPE = {
    (8, "into"): (0.046, 1.240),
    (8, "out"): (0.059, 0.688),
    (20, "into"): (0.028, 0.826),
    (20, "out"): (0.014, 0.828),
}
"""Reflected and transmitted fraction of a P packet's energy, by cells per wavelength."""


def as_published(case):
    case["coupling"] = {"scheme": "paper", "zones": ZONES}
    case["continuum"]["xpic"] = UNDAMPED
    return case


@pytest.mark.parametrize("travel", ["into", "out"])
@pytest.mark.parametrize("wavelength", [8, pytest.param(20, marks=pytest.mark.long)])
def test_it_passes_what_the_prototype_passes(tmp_path, wavelength, travel):
    run = run_case(as_published(strip_case(wavelength, travel)), tmp_path)
    end = energies(run)
    R, T = end.continuum[-1], end.md[-1]
    if travel == "out":
        R, T = T, R
    assert pytest.approx(PROTOTYPE[wavelength, travel], abs=0.015) == (R, T)
    assert "paper is unstable without damping" in (run / "logs" / "coupler.log").read_text()


def test_its_energy_grows_where_that_of_the_velocity_scheme_decays(tmp_path):
    """Waves of 4 to 10 cells, t = 160, nothing damped in the scheme as published."""
    paper = energies(run_case(as_published(broadband_case(160.0)), tmp_path / "paper"))
    ours = energies(run_case(broadband_case(160.0), tmp_path / "velocity"))
    total = paper.continuum + paper.md
    late = paper.time > 80.0
    growth = np.polyfit(paper.time[late], np.log(total[late]), 1)[0]
    print(f"paper: rate {growth:+.4f}, energy {total[-1]:.2f}; velocity: energy ", end="")
    print(f"{ours.continuum[-1] + ours.md[-1]:.3f}")
    assert growth > 0.01
    assert total[-1] > 5.0
    assert ours.continuum[-1] + ours.md[-1] < 0.5
