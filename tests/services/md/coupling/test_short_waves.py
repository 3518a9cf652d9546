"""Short waves near the planes: what the nodes leave out, and what counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_md.coupling.short_waves import SHARE, ShortWaves
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.energies import Energies
from tests.services.md.block import FORCE
from tests.services.md.driving import energies

CELL = 2.6


@pytest.fixture
def block(start: Callable[[Case], MdSide], make: Callable[..., Case]) -> tuple[ShortWaves, MdSide]:
    """The atoms of a block at rest, and a monitor that has seen them so."""
    case = make(**FORCE)
    side = start(case)
    monitor = ShortWaves(make_plan(case), side.atoms)
    assert monitor.look(energies(side)) == ()
    return monitor, side


def wave(side: MdSide, cells: float, strain: float = 1e-2) -> None:
    """Give all atoms the velocities of a plane wave of so many cells."""
    k = 2.0 * np.pi / (cells * CELL)
    side.atoms.v[:, 0] = 9.5 * strain * np.sin(k * side.atoms.site[:, 0])


def look(monitor: ShortWaves, side: MdSide, **changes: Any) -> float:
    """Share of short waves that is found; 0 if there is no finding."""
    of_side: Energies = msgspec.structs.replace(energies(side), **changes)
    found = monitor.look(of_side)
    return found[0].value if found else 0.0


def test_long_waves_are_silent_and_short_ones_are_not(block) -> None:
    monitor, side = block
    for cells in (20.0, 8.0, 4.0):
        wave(side, cells)
        assert look(monitor, side) == 0.0
    for cells in (2.0, 1.5):
        wave(side, cells)
        assert look(monitor, side) > SHARE


def test_a_crystal_that_hardly_moves_is_silent(block) -> None:
    monitor, side = block
    wave(side, 1.5, strain=5e-5)
    assert look(monitor, side) == 0.0


def test_short_waves_that_are_little_beside_the_motion_so_far(block) -> None:
    monitor, side = block
    wave(side, 1.5)
    assert look(monitor, side, kinetic=1e4) == 0.0


def test_heat_of_a_thermostat_is_explained(block) -> None:
    monitor, side = block
    wave(side, 1.5)
    assert look(monitor, side, fix_work=1e3) == 0.0
    assert look(monitor, side, fix_work=1e-6) > SHARE


def test_atoms_that_are_warm_from_the_start(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    case = make(**FORCE)
    side = start(case)
    side.atoms.v[:] = np.random.default_rng(1).normal(0.0, 0.2, side.atoms.v.shape)
    monitor = ShortWaves(make_plan(case), side.atoms)
    assert look(monitor, side) == 0.0
    assert look(monitor, side) == 0.0


def test_a_short_wave_of_the_initial_state_is_no_heat(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    packet = {"center": 26.0, "wavelength": 2.0 * CELL, "strain": 5e-3, "cycles": 3.0}
    case = make(**FORCE, initial={"packets": [packet]})
    side = start(case)
    assert look(ShortWaves(make_plan(case), side.atoms), side) > SHARE


def test_it_goes_on_from_its_state(block, make: Callable[..., Case]) -> None:
    monitor, side = block
    look(monitor, side, kinetic=1e4)
    other = ShortWaves(make_plan(make(**FORCE)), side.atoms)
    other.restore(monitor.state())
    wave(side, 1.5)
    assert look(other, side) == 0.0, "it knows the largest energy, and that the atoms were cold"
    other.restore(np.array([0.0, 0.0]))
    assert look(other, side) > SHARE
