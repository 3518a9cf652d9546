"""The sweeps against weights from the definition and plain matrices, in 1, 2 and 3 dimensions."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from gimpmd_gimp.sweeps import kernels
from gimpmd_gimp.sweeps.kernels import Frames, Stencils
from gimpmd_schemas.arrays import Float32s, Floats, Ints
from gimpmd_schemas.grid.interpolation import stencil

H = 0.25
SHAPES = ((9,), (9, 7), (9, 7, 8))
KINDS = {"gimp": kernels.GIMP, "bspline": kernels.BSPLINE, "linear": kernels.GIMP}
ROUND = 1e-13
DEFINED = 2e-9
"""``linear`` is GIMP with domains of half-width HAT, 1e-9 cells."""


@dataclass
class Case:
    """Points in two blocks of one flat array, and their weights as dense matrices.

    ``S[i, p]`` and ``G[i, p, e]`` are what the sweeps shall use, worked out node by node.
    """

    s: Stencils
    frames: Frames
    kind: int
    order: Ints
    x: Floats
    half: Floats
    F: Floats
    home: Float32s
    size: int
    nodes: Floats
    S: Floats
    G: Floats

    def fill(self, stretch: bool = False) -> tuple[int, int]:
        arrays = (self.x, self.half, self.F, self.home)
        return kernels.fill_stencils(
            self.order, 0, self.order.size, self.s, self.frames, self.kind, stretch, *arrays
        )


def hat(u: float) -> float:
    return max(0.0, 1.0 - abs(u))


def weight(kind: str, u: float, half: float) -> float:
    """Weight of a node at a distance of u cells: the hat's mean over a domain (paper Eq. 9)."""
    if kind == "linear":
        return hat(u)
    if kind == "bspline":
        half = 0.5
    ends = np.unique(np.clip([u - half, -1.0, 0.0, 1.0, u + half], u - half, u + half))
    # the hat is straight between kinks: the midpoint rule is exact
    return sum((b - a) * hat(0.5 * (a + b)) for a, b in pairwise(ends)) / (2.0 * half)


def slope(kind: str, u: float, half: float) -> float:
    """Derivative of ``weight`` with respect to u."""
    if kind == "linear":
        return -float(np.sign(u)) if abs(u) < 1.0 else 0.0
    if kind == "bspline":
        half = 0.5
    return (hat(u + half) - hat(u - half)) / (2.0 * half)


def make_case(dim: int, kind: str = "gimp", count: int = 30, seed: int = 1) -> Case:
    """Random points in two blocks that follow each other in flat arrays."""
    rng = np.random.default_rng(seed)
    shape = np.array([SHAPES[dim - 1], SHAPES[dim - 1][::-1]])
    strides = np.array([[np.prod(row[d + 1 :]) for d in range(dim)] for row in shape])
    strides = strides.astype(np.int64)
    sizes = shape.prod(axis=1)
    offset = np.array([0, sizes[0]])
    first = rng.uniform(-1.0, 1.0, (2, dim))  # position of each block's first node
    middle = 0.5 * (shape - 1)
    per_cell = np.array([1.0 / H, 2.0 / H])
    centre = first + middle / per_cell[:, None]
    frames = Frames(
        centre, middle, per_cell, shape.astype(np.int64), strides, offset, np.zeros(dim)
    )

    block = rng.integers(0, 2, count).astype(np.int32)
    t = rng.uniform(1.5, shape[block] - 2.5)
    half = np.full((count, dim), kernels.HAT) if kind == "linear" else 0.0
    half = half + rng.uniform(0.05, 0.5, (count, dim)) * (kind != "linear")
    x = first[block] + t / per_cell[block][:, None]
    s = kernels.make_stencils(block, frames, detours=1)

    size = int(sizes.sum()) + 5  # a few nodes beyond the blocks: twins
    nodes = np.zeros((size, dim))
    S, G = np.zeros((size, count)), np.zeros((size, count, dim))
    for b in range(2):
        for index in itertools.product(*(range(n) for n in shape[b])):
            i = offset[b] + int(np.dot(index, strides[b]))
            nodes[i] = first[b] + np.array(index) / per_cell[b]
            for p in np.flatnonzero(block == b):
                u = t[p] - np.array(index)
                w = [weight(kind, u[d], half[p, d]) if abs(u[d]) < 1.5 else 0.0 for d in range(dim)]
                S[i, p] = np.prod(w)
                for e in range(dim):
                    if abs(u[e]) < 1.5:
                        others = np.prod([w[d] for d in range(dim) if d != e])
                        G[i, p, e] = slope(kind, u[e], half[p, e]) * others * per_cell[b]
    F = np.eye(dim) + rng.uniform(-0.1, 0.1, (count, dim, dim))
    order = rng.permutation(count)
    return Case(s, frames, KINDS[kind], order, x, half, F, t.astype(np.float32), size, nodes, S, G)


@pytest.fixture(params=[1, 2, 3], ids=["1d", "2d", "3d"], scope="module")
def dim(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(params=list(KINDS), scope="module")
def case(request: pytest.FixtureRequest, dim: int) -> Case:
    made = make_case(dim, request.param)
    assert made.fill() == (0, 0)
    return made


def random(*shape: int, seed: int = 2) -> Floats:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def sweep(case: Case, kernel: Callable[..., object], *arrays: object) -> None:
    kernel(case.order, 0, case.order.size, case.s, *arrays)


def test_scatters_are_the_weights_of_the_definition(case: Case) -> None:
    count, dim = case.x.shape
    mass, v = random(count), random(count, dim, seed=3)
    M, N = random(case.size), random(case.size, seed=4)
    P, Q = random(case.size, dim, seed=5), random(case.size, dim, seed=6)
    sums = [M + case.S @ mass, N + case.S @ mass]
    momenta = [P + case.S @ (mass[:, None] * v), Q + case.S @ (mass[:, None] * v)]
    sweep(case, kernels.scatter_mass, mass, M)
    sweep(case, kernels.scatter_momentum, mass, v, N, P)
    sweep(case, kernels.scatter_vector, mass, v, Q)
    np.testing.assert_allclose([M, N], sums, atol=DEFINED)
    np.testing.assert_allclose([P, Q], momenta, atol=DEFINED)


def test_internal_force_is_the_gradient_of_the_definition(case: Case) -> None:
    count, dim = case.x.shape
    volume, tau = random(count), random(count, dim, dim, seed=3)
    tau = tau + tau.swapaxes(1, 2)
    J = random(case.size, dim, seed=4)
    expected = J - 0.7 * np.einsum("p,pde,ipe->id", volume, tau, case.G)
    sweep(case, kernels.scatter_force, 0.7, volume, tau, J)
    np.testing.assert_allclose(J, expected, atol=DEFINED / H)


def test_gathers_are_the_weights_of_the_definition(case: Case) -> None:
    count, dim = case.x.shape
    V, q = random(case.size, dim), random(count, dim, seed=3)
    expected = q + 0.3 * case.S.T @ V
    sweep(case, kernels.gather_vector, V, 0.3, q)
    np.testing.assert_allclose(q, expected, atol=DEFINED)


def test_nominal_force_is_that_of_linear_algebra(case: Case) -> None:
    count, dim = case.x.shape
    F = np.eye(dim) + np.random.default_rng(5).uniform(-0.3, 0.3, (count, dim, dim))
    volume, tau = random(count, seed=2), random(count, dim, dim, seed=3)
    tau += tau.swapaxes(1, 2)
    J, expected = np.zeros((2, case.size, dim))
    sweep(case, kernels.scatter_nominal_force, 0.7, volume, F, tau, J)
    sweep(case, kernels.scatter_force, 0.7, volume, np.linalg.solve(F, tau), expected)
    np.testing.assert_allclose(J, expected, atol=100 * DEFINED / H)


def test_kick_changes_velocities_and_then_scatters(case: Case) -> None:
    count, dim = case.x.shape
    U, mass, v = random(case.size, dim), random(count, seed=3), random(count, dim, seed=4)
    P, dv = random(case.size, dim, seed=5), np.zeros((count, dim))
    change = case.S.T @ U
    new = v + change
    momentum = P + case.S @ (mass[:, None] * new)
    between = v + 0.3 * change
    stripe, sums = np.arange(count) % 4, np.zeros((4, 1 + dim))
    energy = np.bincount(stripe, 0.5 * mass * (between**2).sum(axis=1))
    carried = [np.bincount(stripe, mass * between[:, axis]) for axis in range(dim)]
    sweep(case, kernels.kick, U, mass, v, dv, P, 0.3, stripe, sums)
    np.testing.assert_allclose(sums, np.stack([energy, *carried], axis=1), atol=100 * DEFINED)
    np.testing.assert_allclose(dv, change, atol=DEFINED)
    np.testing.assert_allclose(v, new, atol=DEFINED)
    np.testing.assert_allclose(P, momentum, atol=DEFINED)


@pytest.mark.parametrize("finite", [False, True])
def test_motion_deforms_and_moves(case: Case, finite: bool) -> None:
    count, dim = case.x.shape
    V, F, x = random(case.size, dim), random(count, dim, dim, seed=3), random(count, dim, seed=4)
    L = np.einsum("id,ipe->pde", V, case.G)
    deformed = F + 0.1 * (L @ F if finite else L)
    moved = x + 0.4 * case.S.T @ V
    sweep(case, kernels.gather_motion, V, 0.1, finite, F, 0.4, x)
    np.testing.assert_allclose(F, deformed, atol=DEFINED / H)
    np.testing.assert_allclose(x, moved, atol=DEFINED)


def test_no_order_stands_for_all_points_in_turn(dim: int) -> None:
    case = make_case(dim)
    case.order = np.arange(0)
    count = case.x.shape[0]
    arrays = (case.x, case.half, case.F, case.home)
    filled = kernels.fill_stencils(
        case.order, 0, count, case.s, case.frames, case.kind, False, *arrays
    )
    assert filled == (0, 0)
    mass, M = random(count), np.zeros(case.size)
    kernels.scatter_mass(case.order, 3, count, case.s, mass, M)
    np.testing.assert_allclose(M, case.S[:, 3:] @ mass[3:], atol=ROUND)


def test_linear_fields_are_reproduced(case: Case) -> None:
    count, dim = case.x.shape
    c, B = random(dim), random(dim, dim, seed=3)
    V, u, F = c + case.nodes @ B.T, np.zeros((count, dim)), np.zeros((count, dim, dim))
    sweep(case, kernels.gather_motion, V, 1.0, False, F, 1.0, u)
    np.testing.assert_allclose(u, c + case.x @ B.T, atol=ROUND)
    np.testing.assert_allclose(F, np.tile(B, (count, 1, 1)), atol=ROUND / H)


def test_mass_is_kept_and_internal_forces_balance(case: Case) -> None:
    count, dim = case.x.shape
    mass, tau = random(count), random(count, dim, dim, seed=3)
    M, J = np.zeros(case.size), np.zeros((case.size, dim))
    sweep(case, kernels.scatter_mass, mass, M)
    sweep(case, kernels.scatter_force, 1.0, mass, tau + tau.swapaxes(1, 2), J)
    assert M.sum() == pytest.approx(mass.sum(), abs=ROUND)
    np.testing.assert_allclose(J.sum(axis=0), 0.0, atol=10 * ROUND / H)


def test_gathers_are_the_transposes_of_scatters(case: Case) -> None:
    """What makes momentum and work exact, whatever the weights: no reference is needed."""
    count, dim = case.x.shape
    mass, q, Q = random(count), random(count, dim, seed=3), random(case.size, dim, seed=4)
    scattered, gathered = np.zeros_like(Q), np.zeros_like(q)
    sweep(case, kernels.scatter_vector, mass, q, scattered)
    sweep(case, kernels.gather_vector, Q, 1.0, gathered)
    assert np.sum(Q * scattered) == pytest.approx(np.sum(mass[:, None] * q * gathered), abs=ROUND)

    tau = random(count, dim, dim, seed=5)
    tau = tau + tau.swapaxes(1, 2)
    force, L = np.zeros_like(Q), np.zeros((count, dim, dim))
    sweep(case, kernels.scatter_force, 1.0, mass, tau, force)
    sweep(case, kernels.gather_motion, Q, 1.0, False, L, 0.0, q)
    work = np.einsum("p,pde,pde", mass, tau, L)
    assert np.sum(Q * force) == pytest.approx(-work, abs=10 * ROUND / H)


def test_detours_lead_to_other_nodes(dim: int) -> None:
    case = make_case(dim)
    case.fill()
    twin = case.size - 1
    cut = np.array([3, 8])
    reach = np.array(list(itertools.product(range(3), repeat=dim)))
    detour = np.zeros((2, 3**dim), dtype=np.int64)
    for row, p in enumerate(cut):
        nodes = case.s.base[p] + reach @ case.s.strides[case.s.block[p]]
        hidden = nodes[nodes.size // 2]  # the middle node always has a weight
        detour[row] = np.where(nodes == hidden, twin, nodes)
        case.s.base[p] = -1 - row
        for matrix in (case.S, case.G):
            matrix[twin, p], matrix[hidden, p] = matrix[hidden, p].copy(), 0.0
    case.s = case.s._replace(detour=detour)
    assert case.S[twin, cut].min() > 0.0

    test_scatters_are_the_weights_of_the_definition(case)
    test_internal_force_is_the_gradient_of_the_definition(case)
    test_gathers_are_the_weights_of_the_definition(case)
    test_kick_changes_velocities_and_then_scatters(case)
    test_motion_deforms_and_moves(case, finite=True)


def test_weights_are_those_of_the_contract(dim: int) -> None:
    """The other services interpolate with ``stencil``."""
    case = make_case(dim)
    case.fill()
    for p, axis in itertools.product(range(case.x.shape[0]), range(dim)):
        b = case.s.block[p]
        y = case.x[p, axis] - case.frames.centre[b, axis]
        t = y * case.frames.per_cell[b] + case.frames.middle[b, axis]
        _, *numbers = stencil(t, case.half[p, axis])
        assert case.s.w[p, :, axis].tolist() == pytest.approx([numbers[0], numbers[2]], abs=ROUND)
        first = case.s.g[p, axis] / case.frames.per_cell[b]
        assert [first, 1.0 + first] == pytest.approx([numbers[3], numbers[5]], abs=ROUND)


def test_domains_follow_the_deformation_up_to_half_a_cell(dim: int) -> None:
    stretched, reference = make_case(dim), make_case(dim)
    stretched.F[0] *= 20.0
    diagonal = stretched.F[:, range(dim), range(dim)]
    reference.half[:] = np.minimum(diagonal * stretched.half, 0.5)
    stretched.fill(stretch=True)
    reference.fill()
    np.testing.assert_allclose(stretched.s.w, reference.s.w, atol=ROUND)
    np.testing.assert_allclose(stretched.s.g, reference.s.g, atol=ROUND / H)


def test_periodic_images_have_one_stencil(dim: int) -> None:
    case, image = make_case(dim), make_case(dim)
    period = np.full(dim, 20.0)
    image.x += period * np.array([-2.0, 1.0, 3.0])[:dim]
    case.frames, image.frames = (c.frames._replace(period=period) for c in (case, image))
    assert case.fill() == (0, 0)
    assert image.fill() == (0, 0)
    np.testing.assert_array_equal(case.s.base, image.s.base)
    np.testing.assert_allclose(case.s.w, image.s.w, atol=100 * ROUND)


def test_lost_and_drifted_points_are_counted(dim: int) -> None:
    case = make_case(dim)
    case.fill()
    before = case.s.base.copy()
    case.x[0] += 100.0
    case.x[1, -1] = np.nan
    case.home[2, 0] += 0.3
    case.home[3] += 0.2
    assert case.fill() == (2, 1)
    np.testing.assert_array_equal(case.s.base, before)
