"""The force scheme's atoms: ghosts follow the nodes and hand back the forces on them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_md.roles import BOUNDARY
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import levels, times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.block import FORCE, MASS, ROW, SIGMA, TAU, WIDTH, A, argon
from tests.services.md.driving import advance, energies, having, total

Start = Callable[[Case], MdSide]
CUTOFF = 2.5
PACKET = {"center": 15.0, "wavelength": 13, "strain": 1e-2, "cycles": 0.5}
"""A packet astride the left plane."""

STRIP: dict[str, Any] = {
    **FORCE,
    "domain": {"box": [[0, WIDTH * 3], [0, WIDTH]], "periodic": [False, True]},
    "grid__cell": WIDTH / 8,
    "md__region": [[WIDTH, 2 * WIDTH], [0, WIDTH]],
    "md__variables": {"edge": "p"},
    "coupling__planes": {"left": 48 * A / 2, "right": 78 * A / 2},
}
"""A strip, periodic along y."""


def atoms(side: MdSide) -> tuple[np.ndarray, ...]:
    """Lattice positions, positions, velocities and forces, and which atoms are ghosts."""
    a = side.atoms
    return *(array.copy() for array in (a.site, a.x, a.v, a.f)), having(side, BOUNDARY)


def lennard_jones(x: np.ndarray, ghost: np.ndarray, period: float = 0.0) -> np.ndarray:
    """Forces of all pairs but those of two ghosts, one by one from the potential."""
    d = x[:, None] - x[None]
    if period:
        d[..., 1] -= period * np.round(d[..., 1] / period)
    r2 = (d**2).sum(axis=2)
    acts = (r2 < CUTOFF**2) & (r2 > 0.0) & ~(ghost[:, None] & ghost[None])
    r2 = np.where(acts, r2, 1.0)
    s = r2**-3
    return (np.where(acts, 24.0 * (2.0 * s * s - s) / r2, 0.0)[..., None] * d).sum(axis=1)


def hats(case: Case, nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Linear hat functions of nodes at positions by the definition, shape ``(n, nodes)``."""
    grid = make_plan(case).background_grid()
    weights = np.ones((len(x), len(nodes)))
    for axis in range(2):
        away = np.abs(x[:, None, axis] - grid.positions()[nodes][None, :, axis])
        if grid.periodic[axis]:
            length = grid.cell * grid.cells[axis]
            away = np.minimum(away, length - away)
        weights *= np.clip(1.0 - away / grid.cell, 0.0, None)
    return weights


def wave(case: Case, side: MdSide, k: int, amplitude: float = 0.1) -> np.ndarray:
    x = make_plan(case).background_grid().positions()[side.needs]
    length = np.array([26.0, case.domain.box[1][1] / 2.0])
    return amplitude * np.sin(0.3 * (k + 0.5)) * np.sin(2.0 * np.pi * x / length)[:, ::-1]


# --- forces -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        FORCE,
        STRIP,
        {  # at an edge of the domain, with planes on three sides
            **FORCE,
            "md__region": [[13, 39], [0, 26]],
            "coupling__planes": {"left": 28 * A / 2, "right": 65 * A / 2, "top": 24 * ROW},
        },
    ],
    ids=["inside", "periodic", "edge"],
)
def test_nodes_bear_the_forces_of_free_atoms_on_ghosts(
    start: Start, make: Callable[..., Case], changes: dict[str, Any]
) -> None:
    """Every pair summed from positions, every weight by its definition."""
    case = make(**changes)
    side = start(case)
    for k in range(12):
        advance(side, wave(case, side, k))
    lattice, x, _, f, ghost = atoms(side)
    period = WIDTH if case.domain.periodic[1] else 0.0
    pairs = lennard_jones(x, ghost, period)
    np.testing.assert_allclose(f, pairs, atol=1e-11 * np.abs(pairs).max())
    nodal = side.zone_fields()["force"]
    expected = hats(case, side.offers, lattice[ghost]).T @ pairs[ghost]
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(nodal, expected, atol=1e-11 * np.abs(pairs).max())
    # action and reaction: all that free atoms feel in sum comes from ghosts
    np.testing.assert_allclose(nodal.sum(axis=0), -pairs[~ghost].sum(axis=0), atol=1e-10)


def test_power_of_nodes_is_power_of_ghosts(start: Start, make: Callable[..., Case]) -> None:
    case = make(**FORCE)
    side = start(case)
    for k in range(8):
        velocity = wave(case, side, k)
        advance(side, velocity)
    np.testing.assert_array_equal(side.offers, side.needs)  # on one rank
    _, _, v, f, ghost = atoms(side)
    nodal = float((side.zone_fields()["force"] * velocity).sum())
    assert abs(nodal) > 1e-3
    scale = float(np.abs(f[ghost] * v[ghost]).sum())
    assert nodal == pytest.approx(float((f[ghost] * v[ghost]).sum()), abs=1e-14 * scale)


def test_forces_in_metal_units_are_mechanical(
    start: Start, make: Callable[..., Case], folder: Path
) -> None:
    """The same crystal in argon's units: mass length / time^2 scales, whatever eV and bar are."""
    scaled = make(
        **argon(),
        coupling={
            "scheme": "force",
            "planes": {name: SIGMA * at for name, at in FORCE["coupling__planes"].items()},
            "crystal": {
                **FORCE["coupling__crystal"],
                "vectors": (SIGMA * np.array(FORCE["coupling__crystal"]["vectors"])).tolist(),
                "origin": (SIGMA * np.array(FORCE["coupling__crystal"]["origin"])).tolist(),
            },
        },
    )
    forces = []
    for case, speed in ((make(**FORCE), 1.0), (scaled, SIGMA / TAU)):
        side = start(case)
        x = make_plan(case).background_grid().positions()[side.needs]
        x = x / (levels.finest_cell(case) / 2.6)
        for k in range(10):
            shape = np.sin(2.0 * np.pi * x / 26.0)[:, ::-1]
            advance(side, 0.05 * np.sin(0.3 * k) * shape * speed)
        forces.append(side.zone_fields()["force"])
    in_reduced = forces[1] / (MASS * SIGMA / TAU**2)
    np.testing.assert_allclose(in_reduced, forces[0], atol=1e-6 * np.abs(forces[0]).max())


# --- motion -------------------------------------------------------------------------------


def test_ghosts_follow_a_uniform_velocity_exactly(start: Start, make: Callable[..., Case]) -> None:
    case = make(**FORCE)
    side = start(case)
    for _ in range(10):
        advance(side, np.tile([0.03, -0.02], (side.needs.size, 1)))
    lattice, x, v, _, ghost = atoms(side)
    np.testing.assert_allclose(v[ghost], np.tile([0.03, -0.02], (ghost.sum(), 1)), atol=1e-16)
    moved = 10 * times.step(case) * np.array([0.03, -0.02])
    np.testing.assert_allclose(
        x[ghost] - lattice[ghost], np.tile(moved, (ghost.sum(), 1)), atol=1e-12
    )


@pytest.mark.parametrize("changes", [FORCE, STRIP], ids=["inside", "periodic"])
def test_ghosts_stay_on_the_nodes(
    start: Start, make: Callable[..., Case], changes: dict[str, Any]
) -> None:
    """Displacements of ghosts are those of the nodes, interpolated, to the end."""
    astride = {**PACKET, "center": changes["coupling__planes"]["left"]}
    case = make(**changes, initial={"packets": [astride]})
    side = start(case)
    U = initial_state(make_plan(case), make_plan(case).background_grid().positions()[side.needs])[0]
    assert np.abs(U).max() > 0.005
    for k in range(100):
        velocity = wave(case, side, k)
        advance(side, velocity)
        U += times.step(case) * velocity
    lattice, x, _, _, ghost = atoms(side)
    d = (x - lattice)[ghost]
    if case.domain.periodic[1]:
        d[:, 1] -= WIDTH * np.round(d[:, 1] / WIDTH)
    expected = hats(case, side.needs, lattice[ghost]) @ U
    assert np.abs(expected).max() > 0.02
    np.testing.assert_allclose(d, expected, atol=1e-12)


def test_the_first_part_holds_the_forces_of_the_initial_state(
    start: Start, make: Callable[..., Case]
) -> None:
    """Ghosts stand where the nodes put them, free atoms where the case does."""
    case = make(**FORCE, initial={"packets": [PACKET]})
    side = start(case)
    lattice, x, v, _, ghost = atoms(side)
    nodes = make_plan(case).background_grid().positions()[side.needs]
    S = hats(case, side.needs, lattice[ghost])
    for field, nodal, free in zip(
        (x - lattice, v),
        initial_state(make_plan(case), nodes)[:2],
        initial_state(make_plan(case), lattice)[:2],
        strict=True,
    ):
        np.testing.assert_allclose(field[ghost], S @ nodal, atol=1e-13)
        np.testing.assert_allclose(field[~ghost], free[~ghost], atol=1e-13)
        assert np.abs(S @ nodal - free[ghost]).max() > 1e-4  # the two do differ
    pairs = lennard_jones(x, ghost)
    expected = hats(case, side.offers, lattice[ghost]).T @ pairs[ghost]
    np.testing.assert_allclose(side.zone_fields()["force"], expected, atol=1e-10)


def test_relaxation_holds_the_ghosts(start: Start, make: Callable[..., Case]) -> None:
    edge = {
        **FORCE,
        "md__region": [[0, 26], [13, 39]],
        "coupling__planes": {"right": 42 * A / 2, "bottom": 17 * ROW, "top": 37 * ROW},
    }
    side = start(make(**edge))
    lattice, _, _, f, ghost = atoms(side)
    rest = side.atoms.rest
    np.testing.assert_array_equal(rest[ghost], lattice[ghost])
    assert np.abs(rest - lattice)[~ghost].max() > 1e-3  # the free surface on the left moves
    assert np.abs(f[~ghost]).max() < 1e-4


# --- energy -------------------------------------------------------------------------------


def test_energy_of_free_atoms_among_held_ghosts_is_conserved(
    start: Start, make: Callable[..., Case]
) -> None:
    """Bonds with ghosts count wholly; velocity Verlet keeps the sum to second order in the step."""
    drifts = []
    for timestep, steps in ((0.004, 10), (0.002, 20)):
        case = make(
            **FORCE,
            time={"end": 8, "md_timestep": timestep, "md_steps": steps},
            initial={"packets": [{**PACKET, "center": 26.0}]},
        )
        side = start(case)
        totals = []
        for _ in range(60):
            advance(side)
            totals.append(total(side))
        assert energies(side).interface_work == 0.0
        assert np.mean(totals) > 0.05
        drifts.append(np.ptp(totals) / np.mean(totals))
    assert drifts[1] < 1e-3
    assert drifts[0] / drifts[1] == pytest.approx(4.0, rel=0.3)


def test_interface_work_is_the_energy_gained(start: Start, make: Callable[..., Case]) -> None:
    case = make(**FORCE)
    side = start(case)
    assert energies(side).potential == pytest.approx(0.0, abs=1e-10)
    for k in range(60):
        advance(side, wave(case, side, k, 0.05))
    gained = total(side)
    assert gained > 0.1
    assert energies(side).interface_work == pytest.approx(gained, rel=0.01)


def test_mass_and_momentum_are_those_of_free_atoms(start: Start, make: Callable[..., Case]) -> None:
    side = start(make(**FORCE))
    side.atoms.v[:] = (0.3, -0.2)
    ghost = atoms(side)[-1]
    side.finish()
    found = energies(side)
    free = int((~ghost).sum())
    assert 0 < free < ghost.size
    assert found.mass == free
    assert found.momentum[0] == pytest.approx(0.3 * free)
    assert found.kinetic == pytest.approx(0.5 * 0.13 * free)
