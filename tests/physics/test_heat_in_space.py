"""Heat in copper, coupled by the sites scheme: energy, strain and momentum keep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_schemas.mechanics.units import UNITS
from tests.physics.interface.copper_heat import (
    mean_strains,
    run_heated,
    thermal_momentum,
    trend,
)
from tests.physics.interface.impulses import try_kind
from tests.physics.strips import Run

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

TREND = 1e-6
"""Required: change of the energy per picosecond, over the energy."""


def off(run: Run, temperature: float) -> np.ndarray:
    """Change of the momentum over the thermal one, by time and axis."""
    momentum = run.energies.total("momentum")
    scale = thermal_momentum(run.energies.md.mass[0], temperature, UNITS[run.plan.units])
    return np.asarray((momentum - momentum[0]) / scale)


@pytest.mark.parametrize("temperature", [1.0, 300.0])
def test_energy_and_strain_have_no_trend(temperature: float, tmp_path: Path) -> None:
    """In 100 ps, to the standard error; momentum departs as far as sums over dt and dt_MD do."""
    run = run_heated("slab", temperature, 16, 100.0, tmp_path)
    relative = run.energies.energy / run.energies.energy[0] - 1.0
    energy = trend(run.energies.time, relative)
    assert energy.error < 0.5 * TREND
    assert abs(energy.slope) < TREND
    assert np.abs(relative).max() < 2e-3
    times, strains = mean_strains(run)
    strain = trend(times, np.trace(strains, axis1=1, axis2=2) / 3.0)
    assert abs(strain.slope) < 4.0 * strain.error
    assert np.abs(off(run, temperature)).max() < 0.2  # 1 - x cot x of the fastest vibration


def test_momentum_is_exact_with_one_md_step(tmp_path: Path) -> None:
    """Nodes then get what atoms give. With four the momentum departs."""
    one, four = (
        np.abs(off(run_heated("box", 300.0, n, 0.32, tmp_path / str(n)), 300.0)) for n in (1, 4)
    )
    assert one.max() < 1e-12
    assert 1e-4 < four.max() < 0.02


def test_nodes_that_respond_to_every_md_step_keep_all_sums() -> None:
    """The variant r-RESPA: round-off in momentum and in what atoms and nodes exchange."""
    sums, mass = try_kind("every step", "box", 300.0, 16, 0.32)
    energy, momentum, _, exchanged, of_atoms = (np.array(each) for each in zip(*sums, strict=True))
    scale = thermal_momentum(mass, 300.0, UNITS["metal"])
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * scale
    assert np.abs(exchanged - exchanged[0]).max() < 1e-10 * np.ptp(of_atoms, axis=0).max()
    assert np.abs(energy / energy[0] - 1.0).max() < 2e-3


def test_mean_forces_make_the_energy_grow() -> None:
    """They lag by half a step. The present forces do not: the other kinds judge nothing else."""
    grown, kept = (
        np.array([one.energy for one in try_kind(kind, "slab", 300.0, 16, 0.96)[0]])
        for kind in ("mean", "now")
    )
    assert grown[-1] / grown[0] - 1.0 > 1e-2
    assert abs(kept[-1] / kept[0] - 1.0) < 2e-3
