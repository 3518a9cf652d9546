"""Scheme S on the atoms' side: where they are seen on the grid, and what windows sum up to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.projection import ITERATIONS, step_sizes
from gimpmd_md.coupling.scheme import BOUNDARY, PROJECTED
from gimpmd_md.engines.lammps.backend import LammpsBackend
from gimpmd_schemas.case.form import Case
from tests.services.md.coupling.test_projection import weights

Start = Callable[[Case], LammpsBackend]
Make = Callable[..., Case]

GRADIENT = np.array([[0.002, 0.001], [-0.003, 0.002]])
SHIFT = np.array([0.7, -0.4])


def part(backend: LammpsBackend, bits: int) -> np.ndarray:
    return (backend.engine.atoms("i_gimpmd_part") & bits) != 0


def by_site(backend: LammpsBackend, *names: str) -> tuple[np.ndarray, ...]:
    """Lattice positions and properties of the projected atoms, in an order of their own."""
    pairs = [backend.engine.pairs(name) for name in ("d2_gimpmd_lattice", *names)]
    rows = np.flatnonzero(part(backend, PROJECTED))
    order = rows[np.lexsort(pairs[0][rows].round(6).T)]
    return tuple(pair[order].copy() for pair in pairs)


def heat(backend: LammpsBackend) -> None:
    """Velocities of T = 0.05."""
    v = backend.engine.pairs("v")
    v += np.random.default_rng(5).normal(scale=0.05**0.5, size=v.shape)


@pytest.mark.parametrize("configuration", ["reference", "current"])
def test_boundary_atoms_take_the_field_where_they_stand_on_the_grid(
    start: Start, make: Make, positions: Any, configuration: str
) -> None:
    """At their lattice positions, or where the body has moved to."""
    case = make(continuum__configuration=configuration)
    backend = start(case)
    backend.engine.pairs("x")[:] += SHIFT
    backend.engine.commands(["run 0 post no"])
    fixed = backend.engine.pairs("d2_gimpmd_lattice") + (configuration == "current") * SHIFT
    bound = part(backend, BOUNDARY)
    expected = dict(zip(backend.engine.atoms("id")[bound], fixed[bound] @ GRADIENT.T, strict=True))
    backend.advance(positions(case, backend.needs) @ GRADIENT.T)
    bound = part(backend, BOUNDARY)
    wanted = np.array([expected[name] for name in backend.engine.atoms("id")[bound]])
    np.testing.assert_allclose(backend.engine.pairs("v")[bound], wanted, atol=1e-13)


def drift(start: Start, case: Case, windows: int) -> tuple[float, float]:
    """Velocities of the windows summed up, less the projection of whole displacements.

    Largest difference on the nodes offered, and the largest such displacement.
    """
    backend = start(case)
    heat(backend)
    site, before = by_site(backend, "x")
    summed = np.zeros((backend.offers.size, 2))
    still = np.zeros((backend.needs.size, 2))
    for _ in range(windows):
        backend.advance(still)
        summed += case.step() * backend.zone_fields()["velocity"]
    same, after = by_site(backend, "x")
    np.testing.assert_array_equal(site, same)
    u = after - before
    S = weights(case.background_grid(), site)
    M = S.sum(axis=0)
    inverse = np.divide(1.0, M, out=np.zeros_like(M), where=M > 0.0)[:, None]
    U = np.zeros((M.size, 2))
    for step in (1.0, *step_sizes(ITERATIONS)):
        U += step * inverse * (S.T @ (u - S @ U))
    full = M[backend.offers] > 1.0  # light nodes amplify round-off
    difference = np.abs(summed - U[backend.offers])[full].max()
    return float(difference), float(np.abs(U[backend.offers][full]).max())


def test_windows_sum_up_to_the_projection_of_whole_displacements(start: Start, make: Make) -> None:
    """In the reference configuration, whatever the atoms do on the way: no drift."""
    difference, size = drift(start, make(), 100)
    assert size > 0.03
    assert difference < 1e-9


def test_in_the_current_configuration_thermal_motion_leaves_a_drift(
    start: Start, make: Make
) -> None:
    """Weights that move with the atoms: the products do not sum up to a displacement."""
    difference, _ = drift(start, make(continuum__configuration="current"), 100)
    assert difference > 1e-4
