"""Atoms to nodes and back."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.coupling.projection import ITERATIONS, REACH_CELLS, SOFTEST, NodeMap, step_sizes
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil

SPACING = 1.0359505


BOX = ((0.0, 60.0), (0.0, 48.0))
SEEN = 2


def no_neighbours(field: np.ndarray) -> None:
    """One patch alone: sums are complete."""


def weights(grid: BackgroundGrid, x: np.ndarray) -> np.ndarray:
    """Weights of atoms on all nodes by the definition, shape ``(n, grid.size)``."""
    S = np.zeros((len(x), *grid.shape))
    for a, position in enumerate(x):
        along = [stencil(c / grid.cell, 0.5 * SPACING / grid.cell) for c in position]
        i, j = (place[0] + 2 for place in along)
        S[a, i : i + 3, j : j + 3] = np.outer(along[0][1:4], along[1][1:4])
    return S.reshape(len(x), -1)


def projected(
    grid: BackgroundGrid, nodes: NodeMap, x: np.ndarray, q: np.ndarray, m: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, momentum and velocity on all canonical nodes of the grid, zero on the others."""
    m = np.ones(len(x)) if m is None else m
    part = np.full(len(x), SEEN, dtype=np.int32)
    sums, velocity = nodes.project(part, SEEN, m, x, q, 0.0, no_neighbours)
    places = nodes.places(np.flatnonzero(grid.canonical()))
    out = []
    for field in (sums[:, 0], sums[:, 1:3], velocity):
        whole = np.zeros((grid.size, *field.shape[1:]))
        whole[grid.canonical()] = field[places]
        out.append(whole)
    return out[0], out[1], out[2]


def crystal(width: float, height: float) -> np.ndarray:
    a = 1.1132013
    rows = int(height / (a * 3**0.5 / 2))
    x = np.array(
        [
            ((i + 0.5 * (j % 2) + 0.25) * a, (j + 0.5) * a * 3**0.5 / 2)
            for j in range(rows)
            for i in range(int(width / a))
        ]
    )
    return x[x[:, 0] < width]


@pytest.fixture
def grid() -> BackgroundGrid:
    return BackgroundGrid((0.0, 0.0), 4.0, (15, 12), (False, False))


@pytest.fixture
def nodes(grid: BackgroundGrid) -> NodeMap:
    return NodeMap(grid, np.arange(grid.size), BOX, REACH_CELLS, SPACING)


@pytest.fixture
def atoms() -> np.ndarray:
    return crystal(60.0, 48.0)


def test_atoms_follow_linear_fields_exactly(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    gradient = np.array([[0.01, -0.02], [0.03, 0.04]])
    field = np.full((nodes.size, 2), np.nan)
    rows, which = nodes.spread(np.arange(grid.size))
    field[rows] = (grid.positions() @ gradient.T)[which]
    part = np.full(len(atoms), SEEN, dtype=np.int32)
    part[::3] = 1
    v = np.zeros_like(atoms)
    assert nodes.follow(part, SEEN, atoms, field, v)
    expected = np.where((part == SEEN)[:, None], atoms @ gradient.T, 0.0)
    np.testing.assert_allclose(v, expected, atol=1e-12)
    field[nodes.places(np.array([7 * grid.shape[1] + 7]))] = np.nan
    assert not nodes.follow(part, SEEN, atoms, field, v)


def test_projection_is_that_of_the_definition(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    """Lumped velocity and corrections, written with the full matrix of weights."""
    generator = np.random.default_rng(1)
    m = generator.uniform(0.5, 2.0, len(atoms))
    q = generator.normal(size=atoms.shape)
    S = weights(grid, atoms)
    M = S.T @ m
    inverse = np.divide(1.0, M, out=np.zeros_like(M), where=M > 0.0)[:, None]
    V = inverse * (S.T @ (m[:, None] * q))
    for step in step_sizes(ITERATIONS):
        V += step * inverse * (S.T @ (m[:, None] * (q - S @ V)))
    mass, momentum, velocity = projected(grid, nodes, atoms, q, m)
    np.testing.assert_allclose(mass, M, atol=1e-13 * M.max())
    np.testing.assert_allclose(momentum, S.T @ (m[:, None] * q), atol=1e-12)
    # next to no mass an atom's weight is a difference of numbers near one
    np.testing.assert_allclose(velocity[M > 1e-3], V[M > 1e-3], atol=1e-11)


def test_atoms_are_seen_where_they_were_half_a_window_ago(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    q = np.tile([0.3, -0.2], (len(atoms), 1))
    part = np.full(len(atoms), SEEN, dtype=np.int32)
    m = np.ones(len(atoms))
    seen, _ = nodes.project(part, SEEN, m, atoms + 0.1 * q, q, 0.1, no_neighbours)
    there, _ = nodes.project(part, SEEN, m, atoms, q, 0.0, no_neighbours)
    np.testing.assert_allclose(seen, there, atol=1e-11)


def test_mass_and_momentum_are_exact(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    generator = np.random.default_rng(1)
    m = generator.uniform(0.5, 2.0, atoms.shape[0])
    q = generator.normal(size=atoms.shape)
    mass, momentum, _ = projected(grid, nodes, atoms, q, m)
    assert mass.sum() == pytest.approx(m.sum(), rel=1e-13)
    np.testing.assert_allclose(momentum.sum(axis=0), m @ q, rtol=1e-11, atol=1e-11)


def test_linear_velocity_is_reproduced_inside(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    gradient = np.array([[0.01, -0.02], [0.03, 0.04]])
    _, _, velocity = projected(grid, nodes, atoms, atoms @ gradient.T)
    x = grid.positions()
    deep = ((x > 16.0) & (x < [44.0, 32.0])).all(axis=1)
    # the lattice is not symmetric about a node: the sums of a stencil are off by a part of spacing
    error = np.abs(velocity - x @ gradient.T)[deep].max()
    assert error < 0.02 * np.abs(gradient).max() * grid.cell


def test_steps_leave_the_least_that_a_polynomial_can() -> None:
    """Chebyshev: of all polynomials with p(0) = 1 theirs is the least on the interval."""
    eigenvalue = np.linspace(SOFTEST, 1.0, 1001)
    left = np.prod([1.0 - step * eigenvalue for step in step_sizes(3)], axis=0)
    center = (1.0 + SOFTEST) / (1.0 - SOFTEST)
    assert np.abs(left).max() == pytest.approx(1.0 / (4.0 * center**3 - 3.0 * center))
    assert step_sizes(0).size == 0


def test_linear_velocity_is_reproduced_where_the_crystal_ends(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    """The last nodes see one side alone; both sides of a coupling meet a cell further in."""
    cut = atoms[atoms[:, 0] > 16.0]
    q = np.column_stack([cut[:, 0], 0.0 * cut[:, 0]]) / grid.cell
    mass, momentum, velocity = projected(grid, nodes, cut, q)
    x, y = grid.positions().T

    def shift(of: float, V: np.ndarray) -> float:
        line = (x == of) & (y > 12.0) & (y < 36.0)
        return float(np.abs(V[line, 0] - x[line] / grid.cell).max())

    seen = mass[:, None] > 0.0
    lumped = np.divide(momentum, mass[:, None], out=np.zeros_like(momentum), where=seen)
    assert shift(16.0, lumped) > 0.3  # a third of a cell for hats: their weight's own mean
    center = (1.0 + SOFTEST) / (1.0 - SOFTEST)
    left = shift(16.0, lumped) / (4.0 * center**3 - 3.0 * center)
    assert shift(16.0, velocity) < left
    assert shift(20.0, velocity) < left


@pytest.mark.parametrize("wavelength", [8.0, 12.0, 20.0])
def test_consistent_projection_keeps_waves_that_lumped_weakens(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray, wavelength: float
) -> None:
    """One lumped projection and interpolation multiply a wave by about sinc^2(k h / 2)^2."""
    wave = np.sin(2.0 * np.pi * atoms[:, 0] / (wavelength * grid.cell))
    q = np.column_stack([wave, 0.0 * wave])
    mass, momentum, velocity = projected(grid, nodes, atoms, q)
    lumped = np.divide(
        momentum, mass[:, None], out=np.zeros_like(momentum), where=mass[:, None] > 0
    )
    deep = (atoms[:, 0] > 12.0) & (atoms[:, 0] < 48.0) & (atoms[:, 1] > 12.0) & (atoms[:, 1] < 36.0)
    S = weights(grid, atoms[deep])

    def rest(field: np.ndarray) -> float:
        return float(np.abs(S @ field[:, 0] - wave[deep]).max())

    assert rest(velocity) < 0.35 * rest(lumped)


@pytest.mark.parametrize("box", [BOX, ((0.0, 60.0), (0.0, 8.0)), ((0.0, 60.0), (40.0, 48.0))])
def test_the_period_makes_no_difference(box: tuple) -> None:
    """Atoms shifted by a period, and patches that hold a part of it, give the same sums."""
    tall = BackgroundGrid((0.0, 0.0), 4.0, (15, 36), (False, True))
    generator = np.random.default_rng(2)
    x = crystal(60.0, 12.0)
    x[:, 1] += box[1][0] - 2.0
    q = generator.normal(size=x.shape)
    whole = NodeMap(
        tall, np.flatnonzero(tall.canonical()), ((0.0, 60.0), (0.0, 144.0)), REACH_CELLS, SPACING
    )
    canonical = np.flatnonzero(tall.canonical())
    some = canonical[
        np.abs((tall.positions()[canonical, 1] - sum(box[1]) / 2 + 72.0) % 144.0 - 72.0)
        <= 0.5 * (box[1][1] - box[1][0]) + 4.0 * REACH_CELLS
    ]
    patch = NodeMap(tall, some, box, REACH_CELLS, SPACING)
    part, m = np.full(len(x), SEEN, dtype=np.int32), np.ones(len(x))
    results = []
    for nodes, shift in ((whole, 0.0), (whole, 144.0), (patch, 0.0), (patch, -144.0)):
        shifted = x + np.array([0.0, shift])
        sums, velocity = nodes.project(part, SEEN, m, shifted, q, 0.0, no_neighbours)
        places = nodes.places(some)
        heavy = sums[places, :1] > 1e-3
        results.append(np.hstack([sums[places, :3], heavy * velocity[places]]))
    assert results[0][:, 0].sum() == pytest.approx(len(x))
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], atol=1e-9)


def test_a_stray_atom_is_an_error(grid: BackgroundGrid, nodes: NodeMap) -> None:
    def project(nodes: NodeMap, *x: tuple[float, float]) -> None:
        part, m = np.full(len(x), SEEN, dtype=np.int32), np.ones(len(x))
        nodes.project(part, SEEN, m, np.array(x), np.zeros((len(x), 2)), 0.0, no_neighbours)

    with pytest.raises(BackendError, match=r"\(70, 3\) has left the background grid"):
        project(nodes, (3.0, 3.0), (70.0, 3.0))
    with pytest.raises(BackendError, match="left the background grid"):
        project(nodes, (3.0, np.nan))
    few = NodeMap(grid, np.arange(grid.size // 2), BOX, REACH_CELLS, SPACING)
    with pytest.raises(BackendError, match="too far outside its patch"):
        project(few, (55.0, 3.0))
    narrow = NodeMap(grid, np.arange(grid.size), ((0.0, 8.0), (0.0, 48.0)), 2.0, SPACING)
    project(narrow, (13.0, 3.0))
    with pytest.raises(BackendError, match="too far outside its patch"):
        project(narrow, (17.0, 3.0))


def test_without_iterations_the_velocity_is_lumped(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    """``V_i = sum_a S_ia m_a v_a / M_i`` (paper section 3.1), nothing more."""
    q = np.sin(atoms)
    part = np.full(len(atoms), SEEN, dtype=np.int32)
    _, velocity = nodes.project(
        part, SEEN, np.ones(len(atoms)), atoms, q, 0.0, no_neighbours, iterations=0
    )
    S = weights(grid, atoms)
    heavy = np.flatnonzero(S.sum(axis=0) > 1e-9)
    heavy = heavy[np.isin(heavy, np.flatnonzero(grid.canonical()))]
    lumped = (S.T @ q)[heavy] / S.sum(axis=0)[heavy, None]
    assert velocity[nodes.places(heavy)] == pytest.approx(lumped, abs=1e-12)
    consistent = projected(grid, nodes, atoms, q)[2][heavy]
    assert np.abs(consistent - lumped).max() > 0.05
