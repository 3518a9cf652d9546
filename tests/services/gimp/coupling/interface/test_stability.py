"""Statics of free atoms and nodes together: no mode of the coupled body is unstable."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.bonds import domain
from gimpmd_gimp.coupling.interface.weights import gradients, hats
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.physics.lattice import AREA, SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import (
    INF,
    ROWS,
    Body,
    half_star,
    make_body,
    weights_of,
)

A = SPACING


def bond_stiffness(R: np.ndarray) -> np.ndarray:
    r = np.linalg.norm(R, axis=-1)[..., None, None]
    n = (R / r[..., 0])[..., :, None]
    first, second = -24.0 * (2.0 * r**-13 - r**-7), 24.0 * (26.0 * r**-14 - 7.0 * r**-8)
    return (second - first / r) * n * np.swapaxes(n, -1, -2) + first / r * np.eye(2)


def continuum(
    grid: BackgroundGrid, points: MaterialPoints
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes with material, their stiffness ``(n, 2, n, 2)`` and mass."""
    by = np.stack([b.toarray() for b in gradients(grid, points.reference, points.half)])
    nodes = np.flatnonzero(np.abs(by).max(axis=(0, 1)) > 1e-12)
    by, R = by[:, :, nodes], half_star()
    bulk = np.einsum("bik,bj,bl->ijkl", bond_stiffness(R), R, R) / AREA
    K = np.einsum("p,jpa,ijkl,lpb->aibk", points.volume, by, bulk, by, optimize=True)
    return nodes, K, weights_of(grid, points)[:, nodes].T @ points.mass


def assemble(body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness of free atoms, then nodes; masses of the nodes; where all stand."""
    grid, lattice = body.grid, body.lattice
    low, high = domain(grid)
    sites = lattice.sites(low - 1e-9, high + 1e-9)
    free = sites[body.interface.free(sites)]
    nodes, bulk, mass = continuum(grid, body.points)
    n = free.shape[0]
    K = np.zeros((n + nodes.size, 2, n + nodes.size, 2))

    def add(row: np.ndarray, stiffness: np.ndarray) -> None:
        used = np.flatnonzero(row)
        K[np.ix_(used, [0, 1], used, [0, 1])] += np.einsum(
            "a,b,ij->aibj", row[used], row[used], stiffness
        )

    for R in half_star():
        for a in range(n):
            other = np.flatnonzero(np.abs(free - free[a] - R).max(axis=1) < 1e-6)
            if other.size:
                row = np.zeros(n + nodes.size)
                row[a], row[other[0]] = -1.0, 1.0
                add(row, bond_stiffness(R))
    ghost = hats(grid, body.bonds.ghost).toarray()[:, nodes]
    for b in range(body.bonds.count):
        row = np.zeros(n + nodes.size)
        row[:n][np.abs(free - body.bonds.free[b]).max(axis=1) < 1e-6] = -1.0
        row[n:] = ghost[b]
        add(row, bond_stiffness(body.bonds.ghost[b] - body.bonds.free[b]))
    K[n:, :, n:, :] += bulk

    linear = body.terms.linear()
    place = n + np.searchsorted(nodes, linear.nodes)
    assert (nodes[place - n] == linear.nodes).all()
    terms = -linear.matrix.toarray().reshape(place.size, 2, place.size, 2)
    K[np.ix_(place, [0, 1], place, [0, 1])] += terms
    size = 2 * (n + nodes.size)
    return K.reshape(size, size), mass, np.concatenate([free, grid.positions()[nodes]])


def planes_beside(lines: np.ndarray, layer: float, shift: float) -> tuple[float, float]:
    """Planes midway between layers next to two node lines, on the continuum's side of them."""
    low, high = (lines - shift) / layer
    return float(np.floor(low) * layer + shift), float(np.ceil(high) * layer + shift)


def placed(h: float, shift: tuple[float, float], rim: tuple[bool, bool] = (False, False)) -> Body:
    """Free atoms in a box of about 13 x 11, two cells of continuum around it, or a rim at hand."""
    cells = np.array([2 + round(13 / h), 2 + round(11 / h)])
    planes = []
    for axis, layer in enumerate((0.5 * A, ROWS)):
        low, high = planes_beside(h * np.array([2, cells[axis]]), layer, shift[axis])
        planes.append((-INF if rim[axis] else low, high))
    origin = (0.25 * A + shift[0], 0.5 * ROWS + shift[1])
    nx, ny = (cells + 2).tolist()
    return make_body(h, (nx, ny), tuple(planes), origin)


SHIFTS = [
    (0.0, 0.0),
    pytest.param((0.31, 0.77), marks=pytest.mark.long),
    (0.9, 1.6),
    pytest.param((1.7, 0.2), marks=pytest.mark.long),
    (2.3, 2.2),
]


@pytest.mark.parametrize("rim", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("h", [2.57, 4.0, 5.1])
def test_only_rigid_motion_costs_no_energy(h, shift, rim):
    K, _, x = assemble(placed(h, shift, rim))
    assert np.abs(K - K.T).max() < 1e-10 * np.abs(K).max()
    spin = np.stack([-x[:, 1], x[:, 0]], axis=1)
    rigid = np.stack([np.tile([1.0, 0.0], len(x)), np.tile([0.0, 1.0], len(x)), spin.ravel()])
    rigid, others = np.split(np.linalg.qr(rigid.T, mode="complete")[0], [3], axis=1)
    cost = np.linalg.norm(K @ rigid, axis=0) / np.abs(K).max()
    assert cost[:2].max() < 1e-12
    if rim == (False, False):  # an unrelaxed surface has a stress of its own, which turns
        assert cost[2] < 1e-8
    lowest = np.linalg.eigvalsh(others.T @ K @ others)[0]
    assert lowest > 1e-4 * np.abs(K).max()  # the whole body bends and shears
