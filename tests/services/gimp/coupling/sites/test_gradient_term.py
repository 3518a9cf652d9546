"""The gradient term: an energy, its forces, and what they are under uniform strain."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.gradient_term import GradientTerm, neighbours, strides
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import VOIGT, unit_strains

GRIDS = [
    BackgroundGrid((0.0, 1.0), 0.7, (6, 5), (False, False)),
    BackgroundGrid((0.0, 1.0, -2.0), 1.3, (5, 4, 6), (False, False, False)),
]

ROUND = [
    BackgroundGrid((0.0, 1.0, -2.0), 1.3, (5, cells, 6), (False, True, False))
    for cells in (1, 2, 3)
]
"""The same, periodic, with few cells along y."""


@pytest.fixture(params=GRIDS, ids=["plane", "space"])
def grid(request: pytest.FixtureRequest) -> BackgroundGrid:
    found: BackgroundGrid = request.param
    return found


@pytest.fixture
def term(grid: BackgroundGrid) -> GradientTerm:
    return in_the_middle(grid)


def in_the_middle(grid: BackgroundGrid) -> GradientTerm:
    """Five nodes in the middle of the grid, two of them neighbours."""
    middle = int(np.ravel_multi_index([PAD + n // 2 for n in grid.cells], grid.shape))
    first, *_, last = strides(grid)
    nodes = np.sort(middle + np.array([0, first, last, -first, 2 * last]))
    shape = (5, grid.dim, len(VOIGT[grid.dim]), grid.dim)
    return GradientTerm(nodes, np.random.default_rng(3).normal(size=shape))


def energy(term: GradientTerm, grid: BackgroundGrid, u: np.ndarray) -> float:
    """The energy as it is written."""
    total, h = 0.0, grid.cell
    u = u[grid.images()]
    for i, c in zip(term.nodes, term.coefficients, strict=True):
        du = np.array([(u[i + s] - u[i - s]) / (2.0 * h) for s in strides(grid)])  # by axis
        strain = [du[j, i] + (du[i, j] if i != j else 0.0) for i, j in VOIGT[grid.dim]]
        for k, s in enumerate(strides(grid)):
            total += np.einsum("mj,m,j", c[k], strain, u[i + s] - 2.0 * u[i] + u[i - s])
    return total


@pytest.mark.parametrize("grid", [*GRIDS, *ROUND])
def test_forces_are_minus_the_derivative_of_the_energy(grid: BackgroundGrid) -> None:
    term = in_the_middle(grid)
    nodes = term.touched(grid)
    forces, rng = term.forces(grid, nodes), np.random.default_rng(4)
    u, along = (np.zeros((grid.size, grid.dim)) for _ in range(2))
    u[nodes], along[nodes] = rng.normal(size=(2, len(nodes), grid.dim))
    assert -0.5 * u[nodes].ravel() @ forces @ u[nodes].ravel() == pytest.approx(
        energy(term, grid, u)
    )
    # the energy is quadratic, so the difference is exact
    change = 0.5 * (energy(term, grid, u + along) - energy(term, grid, u - along))
    assert -along[nodes].ravel() @ (forces @ u[nodes].ravel()) == pytest.approx(change)


def test_uniform_strain_and_rotation(term: GradientTerm, grid: BackgroundGrid) -> None:
    """Second differences vanish: the forces are those of the coefficients, and do no work."""
    nodes = term.touched(grid)
    forces, x = term.forces(grid, nodes), grid.positions()[nodes]
    for m, H in enumerate(unit_strains(grid.dim)):
        found = (forces @ (x @ H.T).ravel()).reshape(-1, grid.dim)
        exact = np.zeros((grid.size, grid.dim))
        for k, (before, after) in enumerate(neighbours(grid, term.nodes)):
            for at, weight in ((before, -1.0), (term.nodes, 2.0), (after, -1.0)):
                np.add.at(exact, at, weight * term.coefficients[:, k, m])
        np.testing.assert_allclose(found, exact[nodes], atol=1e-12)
        assert (found * (x @ H.T)).sum() == pytest.approx(0.0, abs=1e-11)
    turn = np.zeros((grid.dim, grid.dim))
    turn[0, 1], turn[1, 0] = 1.0, -1.0
    np.testing.assert_allclose(forces @ (x @ turn.T).ravel(), 0.0, atol=1e-12)


def test_parts_add_up(term: GradientTerm, grid: BackgroundGrid) -> None:
    nodes, mask = term.touched(grid), np.array([True, False, True, False, False])
    parts = [term.take(chosen).forces(grid, nodes) for chosen in (mask, ~mask)]
    np.testing.assert_allclose(
        (parts[0] + parts[1]).toarray(), term.forces(grid, nodes).toarray(), atol=1e-13
    )
