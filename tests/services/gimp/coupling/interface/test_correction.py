"""Uniform strain is an equilibrium: points, rods, corrections and ghosts balance at every node.

Forces in bonds and the stress of the bulk are sums of the exact potential over the lattice.
"""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.correction import (
    balanced,
    correct,
    inner_nodes,
    join,
    near_planes,
)
from gimpmd_gimp.coupling.interface.lattice import MODES
from gimpmd_gimp.coupling.interface.weights import gradients, hats
from gimpmd_gimp.points.material_points import take
from gimpmd_schemas.errors import BackendError
from tests.physics.lattice import AREA, SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import (
    INF,
    ROWS,
    Body,
    half_star,
    make_body,
)

MU = 27.8332
A, PAIR = SPACING, 2.0 * ROWS
REST = np.zeros((2, 2))
ROTATION = np.array([[0.0, -1.0], [1.0, 0.0]])
GRADIENTS = [REST, *MODES, ROTATION]

PLACES = {
    "inside": ((16 * A, 36 * A), (9 * PAIR, 19 * PAIR)),
    "inside, odd": ((16.5 * A, 31 * A), (9.5 * PAIR, 17 * PAIR)),
    "at an edge": ((-INF, 30 * A), (9 * PAIR, 19 * PAIR)),
    "at the top": ((16 * A, 30.5 * A), (12 * PAIR, INF)),
    "in a corner": ((-INF, 30 * A), (-INF, 19 * PAIR)),
    "half the body": ((-INF, 20 * A), (-INF, INF)),
}
"""Planes, all midway between layers of sites."""


def bond_force(R: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Force in bonds at rest, or its change with a displacement gradient to first order."""
    r = np.linalg.norm(R, axis=1)[:, None]
    first, second = -24.0 * (2.0 * r**-13 - r**-7), 24.0 * (26.0 * r**-14 - 7.0 * r**-8)
    if not H.any():
        return first * R / r
    n, stretch = R / r, R @ H.T
    return (second - first / r) * n * (n * stretch).sum(axis=1, keepdims=True) + first / r * stretch


def raw_residual(body: Body, H: np.ndarray) -> np.ndarray:
    """Nodal force without corrections, over the traction by a cell, on the whole grid."""
    bonds = half_star()
    P = np.einsum("bi,bj->ij", bond_force(bonds, H), bonds) / AREA
    by = gradients(body.grid, body.points.reference, body.points.half)
    q = bond_force(body.bonds.ghost - body.bonds.free, H)
    force = -hats(body.grid, body.bonds.ghost).T @ q
    for j in range(2):
        force -= by[j].T @ (body.points.volume[:, None] * P[:, j])
    force[body.terms.nodes] += body.terms.stretch.T @ q
    return force / (MU * body.grid.cell)


def corrected_residual(body: Body, H: np.ndarray) -> np.ndarray:
    terms = body.terms
    E = np.array([H[0, 0], H[1, 1], H[0, 1] + H[1, 0]])
    S0 = terms.points.S0[:, [[0, 2], [2, 1]]]
    dP = S0 if not H.any() else H @ S0 + (terms.points.dA @ E)[:, [[0, 2], [2, 1]]]
    force = raw_residual(body, H)
    for j in range(2):
        pull = terms.points.volume[:, None] * dP[:, :, j]
        force[terms.nodes] -= terms.gradient[j].T @ pull / (MU * body.grid.cell)
    return force


def body_at(h: float, place: str, shift: tuple[float, float] = (0.0, 0.0), **more) -> Body:
    """A body of about 60 x 60; its crystal and planes lie shifted on the grid."""
    planes = tuple((low + s, high + s) for (low, high), s in zip(PLACES[place], shift, strict=True))
    cells = int(60.0 / h)
    origin = (0.25 * A + shift[0], 0.5 * ROWS + shift[1])
    return make_body(h, (cells, cells), planes, origin, **more)


CELLS = (2.57, 3.856, 4.0, 5.1)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("h", CELLS)
def test_uniform_strain_is_exact_at_every_node(h, place):
    for shift in ((0.0, 0.0), (0.7, 1.3), (2.1, 0.4)):
        body = body_at(h, place, shift)
        nodes = inner_nodes(body.grid)
        assert nodes.sum() == (body.grid.cells[0] - 1) * (body.grid.cells[1] - 1)
        for H in GRADIENTS:
            assert np.abs(corrected_residual(body, H)[nodes]).max() < 1e-11
        # what the correction is for: a corner or a rim leaves something
        assert np.abs(raw_residual(body, MODES[1])[nodes]).max() > 1e-3


@pytest.mark.parametrize("place", PLACES)
def test_a_warm_body_is_in_balance_where_atoms_vibrate_as_in_the_bulk(place):
    """Points push with the thermal stress, ghosts are pushed by the mean forces of their bonds."""
    body = body_at(3.856, place, (0.7, 1.3), heat=0.05)
    q = body.lattice.forces(np.eye(2))
    P = body.lattice.stress(q)
    assert P[0, 0] == pytest.approx(-0.05 * 8.98598, rel=1e-4)  # tests/physics: LAMMPS's
    by = gradients(body.grid, body.points.reference, body.points.half)
    force = -hats(body.grid, body.bonds.ghost).T @ (body.bonds.sign[:, None] * q[body.bonds.kind])
    for j in range(2):
        force -= by[j].T @ (body.points.volume[:, None] * P[:, j])
    force[body.terms.nodes] += body.terms.force(np.zeros((body.terms.nodes.size, 2)))
    assert np.abs(force[inner_nodes(body.grid)]).max() < 1e-11 * MU * body.grid.cell


@pytest.mark.parametrize("h", CELLS)
def test_plane_faces_need_no_correction(h):
    body = body_at(h, "inside", (0.7, 1.3))
    x, planes = body.grid.positions(), body.interface.planes
    far = inner_nodes(body.grid)
    for cx in planes[0]:
        for cy in planes[1]:
            far &= np.abs(x - (cx, cy)).max(axis=1) > h + 2.5
    for H in GRADIENTS:
        assert np.abs(raw_residual(body, H)[far]).max() < 1e-12


@pytest.mark.parametrize("cells", [(22, 11), (15, 15), (14, 14), (11, 22)])
def test_across_a_periodic_axis_planes_are_exact_and_corners_get_so(cells):
    """A strip and an inner region; the crystal's period fits the domain's, not the cell."""
    length = 30 * PAIR
    h = length / cells[1]
    origin = (0.25 * A, 0.5 * ROWS)
    strip = ((16 * A, 36 * A), (-INF, INF))
    body = make_body(h, (int(60 / h), cells[1]), strip, origin, (False, True))
    for H in GRADIENTS:
        assert np.abs(raw_residual(body, H)[inner_nodes(body.grid)]).max() < 1e-12
    assert np.abs(body.correction.dA).max() < 1e-10 * MU

    half = ((-INF, INF), (9 * PAIR, INF))  # periodic in x, up to the top
    width = 52 * A
    h = width / cells[0]
    body = make_body(h, (cells[0], int(60 / h)), half, origin, (True, False))
    inner = ((16 * A, 36 * A), (9 * PAIR, INF))
    for planes in (half, inner):
        body = make_body(h, (cells[0], int(60 / h)), planes, origin, (True, False))
        for H in GRADIENTS:
            assert np.abs(corrected_residual(body, H)[inner_nodes(body.grid)]).max() < 1e-11


@pytest.mark.parametrize("place", PLACES)
def test_nodal_displacements_of_uniform_strain_strain_the_terms_uniformly(place):
    body = body_at(4.0, place, (0.7, 1.3))
    terms = body.terms
    for H in GRADIENTS:
        U = body.grid.positions()[terms.nodes] @ H.T
        across = (body.bonds.ghost - body.bonds.crossing) @ H.T
        assert np.abs(terms.stretch @ U - across).max() < 1e-12
        for j in range(2):
            assert np.abs(terms.gradient[j] @ U - H[:, j]).max() < 1e-13


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("h", CELLS)
def test_corrections_are_small(h, place):
    """Prototype: at most 0.10 (lambda + 2 mu) for regions inside; tangents stay stable."""
    body = body_at(h, place)
    bulk = MU * np.array([[3.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(body.correction.dA).max() < 0.15 * 3.0 * MU
    assert np.abs(body.correction.S0).max() < 0.002 * 3.0 * MU
    assert np.linalg.eigvalsh(bulk + body.correction.dA).min() > 0.85 * MU


def test_the_same_input_gives_the_same_bits():
    a, b = body_at(4.0, "inside"), body_at(4.0, "inside")
    np.testing.assert_array_equal(a.correction.dA, b.correction.dA)
    np.testing.assert_array_equal(a.terms.linear().matrix.data, b.terms.linear().matrix.data)


def test_the_order_of_the_points_does_not_matter():
    """And parts of ranks can be joined: ids tell which point a row belongs to."""
    body = body_at(4.0, "inside")
    order = np.random.default_rng(0).permutation(body.points.count)
    mixed = take(body.points, order)
    again = correct(mixed, body.lattice, body.bonds, body.interface, body.grid)
    for name in ("id", "reference", "half", "volume", "S0", "dA"):
        np.testing.assert_array_equal(getattr(again, name), getattr(body.correction, name))
    left = again.reference[:, 0] < 30.0
    parts = join([again.take(~left), again.take(left)])
    assert parts.count == again.count
    back = np.argsort(parts.id)
    np.testing.assert_array_equal(parts.dA[back], again.dA)


def test_points_near_the_planes_are_within_a_cell():
    body = body_at(4.0, "at the top")
    near = near_planes(body.points, body.interface, 4.0)
    np.testing.assert_array_equal(np.sort(body.points.id[near]), body.correction.id)
    (left, right), (bottom, _) = body.interface.planes
    x, y = body.points.reference.T
    inside = (x > left - 4.0) & (x < right + 4.0) & (y > bottom - 4.0)
    np.testing.assert_array_equal(near, inside)


def test_a_long_perimeter_is_as_exact():
    """Perimeter 3000 at h = 4."""
    body = make_body(4.0, (208, 208), ((20 * A, 716 * A), (10 * PAIR, 412 * PAIR)))
    for H in GRADIENTS:
        assert np.abs(corrected_residual(body, H)[inner_nodes(body.grid)]).max() < 1e-11


def test_corrections_balance_among_themselves_at_a_rim_beside_a_plane():
    """Corrected points of a region not two cells from the rim reach nodes on it."""
    h = 2.57
    body = make_body(h, (12, 12), ((4 * A, 19 * A), (2 * PAIR, 11 * PAIR)))
    terms, rest = body.terms, body.correction.S0[:, [[0, 2], [2, 1]]]
    rim = ~inner_nodes(body.grid)[terms.nodes]
    assert balanced(body.interface, body.grid)[terms.nodes][rim].all()
    touched = np.zeros(rim.sum(), dtype=bool)
    pull = np.zeros((rim.sum(), 2))
    for j in range(2):
        weights = (terms.gradient[j].T)[rim]
        touched |= abs(weights).sum(axis=1) > 0.0
        pull += weights @ (terms.points.volume[:, None] * rest[:, :, j])
    assert touched.sum() > 10
    assert np.abs(pull).max() < 1e-13 * MU * h


def test_a_crystal_that_does_not_fit_the_period_is_refused():
    strip = ((16 * A, 36 * A), (-INF, INF))
    with pytest.raises(BackendError, match=r"domain\.box.*scheme: velocity"):
        make_body(3.8, (15, 15), strip, (0.25 * A, 0.5 * ROWS), (False, True))


def finite_residual(body: Body, H: np.ndarray) -> np.ndarray:
    """Nodal force at finite uniform strain, bulk and bonds by the exact potential."""
    F, terms = np.eye(2) + H, body.terms

    def force_in(R: np.ndarray) -> np.ndarray:
        r = R @ F.T
        square = (r**2).sum(axis=1)[:, None]
        return 24.0 * (square**-4 - 2.0 * square**-7) * r

    P = np.einsum("bi,bj->ij", force_in(half_star()), half_star()) / AREA
    force = -hats(body.grid, body.bonds.ghost).T @ force_in(body.bonds.ghost - body.bonds.free)
    for j, by in enumerate(gradients(body.grid, body.points.reference, body.points.half)):
        force -= by.T @ (body.points.volume[:, None] * P[:, j])
    force[terms.nodes] += terms.force(body.grid.positions()[terms.nodes] @ H.T)
    return force[inner_nodes(body.grid)] / (np.abs(P).max() * body.grid.cell)


@pytest.mark.parametrize(("h", "limit"), [(4.0, 9e-4), (2.57, 2.2e-3)])
def test_finite_strain_leaves_what_the_prototype_left(h, limit):
    """At 1 %, over all three strains; less at less strain in proportion, as the traction is."""
    body = body_at(h, "inside")
    worst = [max(np.abs(finite_residual(body, s * H)).max() for H in MODES) for s in (0.01, 0.005)]
    assert worst[0] < 1.5 * limit
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.1)
