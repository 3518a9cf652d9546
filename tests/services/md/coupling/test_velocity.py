"""Scheme S on the atoms' side: where they are seen on the grid, and what windows sum up to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.projection import ITERATIONS, step_sizes
from gimpmd_md.roles import BOUNDARY, PROJECTED
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.coupling.test_projection import weights
from tests.services.md.driving import advance, having

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]

GRADIENT = np.array([[0.002, 0.001], [-0.003, 0.002]])
SHIFT = np.array([0.7, -0.4])


def by_site(side: MdSide) -> tuple[np.ndarray, np.ndarray]:
    """Lattice positions and positions of the projected atoms, in an order of their own."""
    rows = np.flatnonzero(having(side, PROJECTED))
    site = side.atoms.site[rows]
    order = np.lexsort(site.round(6).T)
    return site[order], side.atoms.x[rows][order]


def heat(side: MdSide) -> None:
    """Velocities of T = 0.05."""
    v = side.atoms.v
    v += np.random.default_rng(5).normal(scale=0.05**0.5, size=v.shape)


@pytest.mark.parametrize("configuration", ["reference", "current"])
def test_boundary_atoms_take_the_field_where_they_stand_on_the_grid(
    start: Start, make: Make, positions: Any, configuration: str
) -> None:
    """At their lattice positions, or where the body has moved to."""
    case = make(continuum__configuration=configuration)
    side = start(case)
    side.atoms.x[:] += SHIFT
    side.atoms.engine.commands(["run 0 post no"])
    fixed = side.atoms.site + (configuration == "current") * SHIFT
    bound = having(side, BOUNDARY)
    expected = dict(
        zip(side.atoms.engine.atoms("id")[bound], fixed[bound] @ GRADIENT.T, strict=True)
    )
    advance(side, positions(case, side.needs) @ GRADIENT.T)
    bound = having(side, BOUNDARY)
    wanted = np.array([expected[name] for name in side.atoms.engine.atoms("id")[bound]])
    np.testing.assert_allclose(side.atoms.v[bound], wanted, atol=1e-13)


def drift(start: Start, case: Case, windows: int) -> tuple[float, float]:
    """Velocities of the windows summed up, less the projection of whole displacements.

    Largest difference on the nodes offered, and the largest such displacement.
    """
    side = start(case)
    heat(side)
    site, before = by_site(side)
    summed = np.zeros((side.offers.size, 2))
    for _ in range(windows):
        advance(side)
        summed += times.step(case) * side.zone_fields()["velocity"]
    same, after = by_site(side)
    np.testing.assert_array_equal(site, same)
    u = after - before
    S = weights(make_plan(case).background_grid(), site)
    M = S.sum(axis=0)
    inverse = np.divide(1.0, M, out=np.zeros_like(M), where=M > 0.0)[:, None]
    U = np.zeros((M.size, 2))
    for step in (1.0, *step_sizes(ITERATIONS)):
        U += step * inverse * (S.T @ (u - S @ U))
    full = M[side.offers] > 1.0  # light nodes amplify round-off
    difference = np.abs(summed - U[side.offers])[full].max()
    return float(difference), float(np.abs(U[side.offers][full]).max())


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
