"""The coupling as published: what it passes, and that it is unstable without damping.

R and T are held to those of the independent prototype in one process (lumped projection,
velocities sampled at the sync, MUSL, zones 4, 8, 8) on the same strip, run for this comparison.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.strips import broadband_case, energies, run_case, strip_case

ZONES = {"outer": 4.0, "incommunicado": 8.0, "inner": 8.0}
UNDAMPED = {"every": 0}

PROTOTYPE = {
    (8, "into"): (0.048, 1.251),
    (8, "out"): (0.090, 0.699),
    (20, "into"): (0.023, 0.842),
    (20, "out"): (0.012, 0.843),
}
"""Reflected and transmitted fraction of a P packet's energy, by cells per wavelength."""


def as_published(case):
    case["coupling"] = {"scheme": "paper", "zones": ZONES}
    case["continuum"]["xpic"] = UNDAMPED
    return case


@pytest.mark.long
@pytest.mark.parametrize("travel", ["into", "out"])
@pytest.mark.parametrize("wavelength", [8, 20])
def test_it_passes_what_the_prototype_passes(tmp_path, wavelength, travel):
    run = run_case(as_published(strip_case(wavelength, travel)), tmp_path)
    continuum, atoms = (side[-1] for side in energies(run))  # all of it, as the prototype's
    shares = (continuum, atoms) if travel == "into" else (atoms, continuum)
    assert pytest.approx(PROTOTYPE[wavelength, travel], abs=0.015) == shares
    assert "paper is unstable without damping" in (run.folder / "logs/coupler.log").read_text()


@pytest.mark.long
def test_its_energy_grows_where_that_of_the_velocity_scheme_decays(tmp_path):
    """Waves of 4 to 10 cells, t = 160, nothing damped in the scheme as published."""
    paper = run_case(as_published(broadband_case(160.0)), tmp_path / "paper")
    exchange = broadband_case(160.0) | {"coupling": {"scheme": "velocity"}}
    ours = sum(energies(run_case(exchange, tmp_path / "velocity")))
    total, time = sum(energies(paper)), paper.energies.time
    late = time > 80.0
    growth = np.polyfit(time[late], np.log(total[late]), 1)[0]
    print(f"paper: rate {growth:+.4f}, energy {total[-1]:.2f}; velocity: energy {ours[-1]:.3f}")
    assert growth > 0.01
    assert total[-1] > 5.0
    assert ours[-1] < 0.5
