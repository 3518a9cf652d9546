"""Atoms to nodes and back: lumped and consistent projection."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest

from gimpmd_md.coupling.projection import (
    CORRECTION_CELLS,
    ITERATIONS,
    LEAST_EIGENVALUE,
    NodeMap,
    step_sizes,
)
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil

SPACING = 1.0359505
SEEN = 2


def project(
    nodes: NodeMap,
    m: np.ndarray,
    x: np.ndarray,
    q: np.ndarray,
    back: float = 0.0,
    iterations: int = ITERATIONS,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodal sums and velocity of atoms of one rank."""
    part = np.full(len(x), SEEN, dtype=np.int32)
    sums, stray = nodes.assemble(part, SEEN, m, x, q, back)
    assert stray < 0
    velocity = nodes.solve(sums, iterations)
    return sums, velocity


def weights(grid: BackgroundGrid, x: np.ndarray) -> np.ndarray:
    """Weights of atoms on all nodes by the definition, shape ``(n, grid.size)``."""
    S = np.zeros((len(x), *grid.shape))
    for a, position in enumerate(x):
        along = [stencil(c / grid.cell, 0.5 * SPACING / grid.cell) for c in position]
        touched = tuple(slice(place[0] + 2, place[0] + 5) for place in along)
        S[a][touched] = reduce(np.multiply.outer, [np.array(place[1:4]) for place in along])
    return S.reshape(len(x), -1)


def projected(
    grid: BackgroundGrid, nodes: NodeMap, x: np.ndarray, q: np.ndarray, m: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, momentum and velocity on all canonical nodes of the grid, zero on the others."""
    m = np.ones(len(x)) if m is None else m
    sums, velocity = project(nodes, m, x, q)
    places = nodes.places(np.flatnonzero(grid.canonical()))
    out = []
    for field in (sums[:, 0], sums[:, 1 : 1 + grid.dim], velocity):
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
    return NodeMap(grid, np.arange(grid.size), SPACING)


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
    _check_definition(grid, nodes, atoms)


def test_projection_of_a_block_is_that_of_the_definition() -> None:
    block = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (5, 4, 6), (False, False, False))
    nodes = NodeMap(block, np.arange(block.size), SPACING)
    rng = np.random.default_rng(5)
    atoms = rng.uniform(0.0, 2.0 * np.array(block.cells), (800, 3))
    _check_definition(block, nodes, atoms)
    field, v = rng.normal(size=(nodes.size, 3)), np.zeros_like(atoms)
    assert nodes.follow(np.full(len(atoms), SEEN, dtype=np.int32), SEEN, atoms, field, v)
    known = field[nodes.places(np.arange(block.size))]
    np.testing.assert_allclose(v, weights(block, atoms) @ known, atol=1e-13)


def _check_definition(grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray) -> None:
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
    m = np.ones(len(atoms))
    seen, _ = project(nodes, m, atoms + 0.1 * q, q, 0.1)
    there, _ = project(nodes, m, atoms, q)
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
    """Of all polynomials with p(0) = 1, Chebyshev's has the least maximum on the interval."""
    eigenvalue = np.linspace(LEAST_EIGENVALUE, 1.0, 1001)
    left = np.prod([1.0 - step * eigenvalue for step in step_sizes(3)], axis=0)
    center = (1.0 + LEAST_EIGENVALUE) / (1.0 - LEAST_EIGENVALUE)
    assert np.abs(left).max() == pytest.approx(1.0 / (4.0 * center**3 - 3.0 * center))
    assert step_sizes(0).size == 0


def test_linear_velocity_is_reproduced_where_the_crystal_ends(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    """The last nodes have atoms on one side only; coupled sides meet a cell further inside."""
    cut = atoms[atoms[:, 0] > 16.0]
    q = np.column_stack([cut[:, 0], 0.0 * cut[:, 0]]) / grid.cell
    mass, momentum, velocity = projected(grid, nodes, cut, q)
    x, y = grid.positions().T

    def shift(of: float, V: np.ndarray) -> float:
        line = (x == of) & (y > 12.0) & (y < 36.0)
        return float(np.abs(V[line, 0] - x[line] / grid.cell).max())

    seen = mass[:, None] > 0.0
    lumped = np.divide(momentum, mass[:, None], out=np.zeros_like(momentum), where=seen)
    assert shift(16.0, lumped) > 0.3  # a third of a cell for hat functions: the mean of the weight
    center = (1.0 + LEAST_EIGENVALUE) / (1.0 - LEAST_EIGENVALUE)
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


@pytest.mark.parametrize(
    "box", [((0.0, 60.0), (0.0, 48.0)), ((0.0, 60.0), (0.0, 8.0)), ((0.0, 60.0), (40.0, 48.0))]
)
def test_the_period_makes_no_difference(box: tuple) -> None:
    """Atoms shifted by a period give the same sums, also in patches that hold a part of it."""
    tall = BackgroundGrid((0.0, 0.0), 4.0, (15, 36), (False, True))
    generator = np.random.default_rng(2)
    x = crystal(60.0, 12.0)
    x[:, 1] += box[1][0] - 2.0
    q = generator.normal(size=x.shape)
    whole = NodeMap(tall, np.flatnonzero(tall.canonical()), SPACING)
    canonical = np.flatnonzero(tall.canonical())
    some = canonical[
        np.abs((tall.positions()[canonical, 1] - sum(box[1]) / 2 + 72.0) % 144.0 - 72.0)
        <= 0.5 * (box[1][1] - box[1][0]) + 4.0 * CORRECTION_CELLS
    ]
    patch = NodeMap(tall, some, SPACING)
    results = []
    for nodes, shift in ((whole, 0.0), (whole, 144.0), (patch, 0.0), (patch, -144.0)):
        shifted = x + np.array([0.0, shift])
        sums, velocity = project(nodes, np.ones(len(x)), shifted, q)
        places = nodes.places(some)
        heavy = sums[places, :1] > 1e-3
        results.append(np.hstack([sums[places, :3], heavy * velocity[places]]))
    assert results[0][:, 0].sum() == pytest.approx(len(x))
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], atol=1e-9)


@pytest.mark.parametrize(("box", "shift"), [((0.0, 40.0), 0.0), ((0.0, 8.0), -40.0)])
def test_periods_of_a_block(box: tuple[float, float], shift: float) -> None:
    """The whole period along z, or a part of it: both agree with sums over all images."""
    block = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (3, 3, 20), (False, True, True))
    rng = np.random.default_rng(6)
    x = rng.uniform([0.0, 0.0, -1.0], [6.0, 6.0, 9.0], (300, 3))
    q = rng.normal(size=x.shape)
    canonical = np.flatnonzero(block.canonical())
    z = block.positions()[canonical, 2]
    some = canonical[(z <= box[1] + 12.0) | (z >= 28.0)]
    nodes = NodeMap(block, some, SPACING)
    moved = x + np.array([0.0, 6.0, shift])
    sums, velocity = project(nodes, np.ones(300), moved, q)
    S = np.zeros((300, block.size))
    half = 0.5 * SPACING / block.cell
    images, index = block.images(), np.array(list(np.ndindex(block.shape))) - 2
    of = {tuple(place): node for node, place in zip(images, index, strict=True)}
    for a, position in enumerate(x / block.cell):
        along = [stencil(c, half) for c in position]
        for i, j, k in np.ndindex(3, 3, 3):
            place = (along[0][0] + i, along[1][0] + j, along[2][0] + k)
            S[a, of[place]] += along[0][1 + i] * along[1][1 + j] * along[2][1 + k]
    M = S.sum(axis=0)
    V = np.divide(S.T @ q, M[:, None], out=np.zeros((block.size, 3)), where=M[:, None] > 0.0)
    for step in step_sizes(ITERATIONS):
        rest = S.T @ (q - S @ V)
        V += step * np.divide(rest, M[:, None], out=np.zeros_like(V), where=M[:, None] > 0.0)
    places, heavy = nodes.places(some), M[some] > 1e-2
    np.testing.assert_allclose(sums[places, 0], M[some], atol=1e-12)
    np.testing.assert_allclose(velocity[places][heavy], V[some][heavy], atol=1e-9)


def test_parts_of_ranks_add_up_across_periodic_faces() -> None:
    """Atoms at a periodic face add to images of nodes; another rank must get these sums too."""
    tall = BackgroundGrid((0.0, 0.0), 4.0, (15, 12), (False, True))
    nodes = NodeMap(tall, np.flatnonzero(tall.canonical()), SPACING)
    x = crystal(60.0, 48.0)
    m, q = np.ones(len(x)), np.sin(x)
    left = (x[:, 0] < 30.0).astype(np.int32)
    places = nodes.places(np.flatnonzero(tall.canonical()))
    one, other, whole = (
        nodes.assemble(role, 1, m, x, q, 0.0)[0] for role in (left, 1 - left, np.ones_like(left))
    )
    np.testing.assert_allclose((one + other)[places], whole[places], atol=1e-12)
    assert whole[places, 0].sum() == pytest.approx(len(x), rel=1e-12)


def test_an_atom_beyond_the_nodes_is_found(grid: BackgroundGrid, nodes: NodeMap) -> None:
    def stray(nodes: NodeMap, *x: tuple[float, float]) -> int:
        part, m, q = np.full(len(x), SEEN, dtype=np.int32), np.ones(len(x)), np.zeros((len(x), 2))
        return nodes.assemble(part, SEEN, m, np.array(x), q, 0.0)[1]

    assert stray(nodes, (3.0, 3.0), (70.0, 3.0)) == 1
    assert stray(nodes, (3.0, np.nan)) == 0
    narrow = NodeMap(grid, np.flatnonzero(grid.positions()[:, 0] <= 16.0), SPACING)
    assert stray(narrow, (13.0, 3.0)) == -1
    assert stray(narrow, (17.0, 3.0)) == 0
    seen = np.full(1, SEEN, dtype=np.int32)
    known, v = np.zeros((narrow.size, 2)), np.zeros((1, 2))
    assert narrow.follow(seen, SEEN, np.array([[13.0, 3.0]]), known, v)
    assert not narrow.follow(seen, SEEN, np.array([[17.0, 3.0]]), known, v)


def test_nodes_need_not_fill_the_window(grid: BackgroundGrid, atoms: np.ndarray) -> None:
    """A rank may hold nodes in several places; a hole in a stencil is noticed."""
    x = grid.positions()
    lower, upper = (atoms[:, 1] < 10.0), (atoms[:, 1] > 34.0) & (atoms[:, 0] > 40.0)
    held = (x[:, 1] <= 16.0) | ((x[:, 1] >= 28.0) & (x[:, 0] >= 32.0))
    apart = NodeMap(grid, np.flatnonzero(held), SPACING)
    some = atoms[lower | upper]
    q = np.sin(some)
    whole, parts = (
        projected(grid, nodes, some, q)
        for nodes in (NodeMap(grid, np.arange(grid.size), SPACING), apart)
    )
    np.testing.assert_array_equal(parts[0], whole[0])
    np.testing.assert_array_equal(parts[2], whole[2])
    middle = np.flatnonzero(held & ~((x == (8.0, 8.0)).all(axis=1)))
    part, m = np.full(1, SEEN, dtype=np.int32), np.ones(1)
    holed = NodeMap(grid, middle, SPACING)
    assert holed.assemble(part, SEEN, m, np.array([[8.0, 8.0]]), np.zeros((1, 2)), 0.0)[1] == 0


def test_without_iterations_the_velocity_is_lumped(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    """``V_i = sum_a S_ia m_a v_a / M_i`` (paper section 3.1), nothing more."""
    q = np.sin(atoms)
    _, velocity = project(nodes, np.ones(len(atoms)), atoms, q, iterations=0)
    S = weights(grid, atoms)
    heavy = np.flatnonzero(S.sum(axis=0) > 1e-9)
    heavy = heavy[np.isin(heavy, np.flatnonzero(grid.canonical()))]
    lumped = (S.T @ q)[heavy] / S.sum(axis=0)[heavy, None]
    assert velocity[nodes.places(heavy)] == pytest.approx(lumped, abs=1e-12)
    consistent = projected(grid, nodes, atoms, q)[2][heavy]
    assert np.abs(consistent - lumped).max() > 0.05
