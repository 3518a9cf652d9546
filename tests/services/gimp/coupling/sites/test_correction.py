"""Uniform strain is in balance at every node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import null_space

from gimpmd_gimp.coupling.sites import correction
from gimpmd_gimp.coupling.sites.gradient_term import neighbours
from gimpmd_gimp.coupling.sites.shells import faces_met
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.elasticity import VOIGT, unit_strains
from tests.services.gimp.coupling.sites.crystals import (
    FCC,
    Crystal,
    aluminium,
    copper,
    copper_110,
    copper_111,
    embedded,
    iron,
    lennard_jones,
    tungsten,
)
from tests.services.gimp.coupling.sites.interfaces import STEP, Measured, Setup, by_the_rule, none
from tests.services.md.crystal.site_off.crystals import SAMPLES, crystal, potential_of

INF = np.inf
BOX: list[Box] = [((-7.0, 7.0), (-8.0, 8.0))]
L: list[Box] = [((-7.0, 12.0), (-7.0, 0.0)), ((-7.0, 0.0), (-7.0, 11.0))]
PAIR: list[Box] = [((-7.0, 3.0), (-7.0, 5.0)), ((23.0, 33.0), (-4.0, 9.0))]


def nodal_forces(setup: Setup, F: np.ndarray) -> np.ndarray:
    """All forces on the freedoms under uniform strain, by the energies as they are written."""
    d, found = len(F), setup.correction
    E = 0.5 * (F.T @ F - np.eye(d))
    voigt = np.array([E[i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT[d]])
    force = setup.residual(F)
    slopes = setup.corrected.slopes(setup.grid)
    S = np.zeros((len(found.S0), d, d))
    for (i, j), values in zip(VOIGT[d], (found.S0 + found.dA @ voigt).T, strict=True):
        S[:, i, j] = S[:, j, i] = values * setup.corrected.volume
    for j, slope in enumerate(slopes):
        force -= slope.T @ (F @ S)[:, :, j]
    if found.gradient is not None:
        nodes = found.gradient.nodes
        pull = np.einsum("nkmj,m->nkj", found.gradient.coefficients, voigt)
        for k, sides in enumerate(neighbours(setup.grid, nodes)):
            force[nodes] += 2.0 * pull[:, k]
            for side in sides:
                np.add.at(force, side, -pull[:, k])
    return setup.T.T @ force


def worst(setup: Setup) -> float:
    """Largest force at rest, or per unit strain, over the traction on the face of a cell."""
    d, inner = setup.crystal.dim, correction.nodes_of_body(setup.grid)
    eye = np.eye(d)
    forces = [nodal_forces(setup, eye)]
    for H in unit_strains(d):
        up, down = (nodal_forces(setup, eye + sign * STEP * H) for sign in (1.0, -1.0))
        forces.append((up - down) / (2.0 * STEP))
    scale = setup.traction * setup.cell ** (d - 1)
    return max(float(np.abs(f[inner]).max()) for f in forces) / scale


@pytest.mark.parametrize("cell", [2.57, 3.856, 5.1])
@pytest.mark.parametrize("boxes", [BOX, L], ids=["box", "L"])
def test_uniform_strain_is_exact_in_two_dimensions(boxes: list[Box], cell: float) -> None:
    setup = by_the_rule(lennard_jones(), cell, boxes)
    before = np.abs(setup.changes[:, correction.nodes_of_body(setup.grid)]).max()
    assert before > 1e-2 * setup.traction * cell
    assert setup.correction.left < 1e-10
    assert worst(setup) < 1e-8  # the second difference of the lattice is in it
    modulus = setup.crystal.tangent()[0, 0, 0, 0]
    assert np.abs(setup.correction.dA).max() < 0.06 * modulus
    assert np.abs(setup.correction.S0).max() < 1e-3 * modulus


@pytest.mark.long
@pytest.mark.parametrize(
    ("make", "cell"),
    [
        (copper, 2.5),
        (copper, 3.0),
        (copper_110, 2.5),
        (aluminium, 2.5),
        (iron, 3.0),
        (tungsten, 3.5),
    ],
)
def test_uniform_strain_is_exact_in_metals(make: Callable[[], Crystal], cell: float) -> None:
    """Cells are given in lattice constants."""
    metal = make()
    a = metal.period[2]
    setup = by_the_rule(metal, cell * a, [((-1.6 * a, 1.6 * a),) * 3])
    assert setup.correction.left < 1e-10
    assert np.abs(setup.correction.dA).max() < 0.02 * setup.crystal.tangent()[0, 0, 0, 0]


@pytest.mark.long
def test_the_gradient_term_mends_what_dA_cannot() -> None:
    """Faces {110}, {111} and {112} of copper."""
    metal = copper_111()
    a = metal.period[0] * 2**0.5
    setup = by_the_rule(metal, 3.0 * a, [((-1.6 * a, 1.6 * a),) * 3])
    found = setup.correction
    assert found.gradient is not None
    assert found.left < 1e-10
    assert worst(setup) < 1e-8
    assert np.abs(found.gradient.coefficients).max() < 1e-4 * setup.traction * setup.cell**2
    assert np.abs(found.dA).max() < 0.02 * metal.tangent()[0, 0, 0, 0]


def test_the_gradient_term_goes_round_a_periodic_axis() -> None:
    """A column two cells long, with faces {111} and {112}."""
    metal = copper_111()
    wide = tuple((-0.5 * length, 0.5 * length) for length in (7.0, 14.0))
    setup = by_the_rule(metal, 2.5 * metal.period[0], [((-INF, INF), *wide)], {0: 2})
    found = setup.correction
    assert found.gradient is not None
    assert found.left < 1e-9
    assert worst(setup) < 1e-8


@pytest.mark.long
@pytest.mark.parametrize(("name", "a"), [("Cu snap", 3.6338), ("Cu eam/alloy", 3.61493)])
def test_residuals_measured_by_lammps_are_corrected(name: str, a: float, tmp_path: Path) -> None:
    """SNAP has no formula here: LAMMPS gives the forces and the stress at 13 strains."""
    with crystal(SAMPLES[name], tmp_path) as cell:
        scaled = Crystal(np.full(3, a), a * FCC, np.full(3, a), cell.engine.pair_cutoff(), none)
        shells = by_the_rule(scaled, 2.5 * a, [((-1.6 * a, 1.6 * a),) * 3]).shells
        potential = with_off_sites(potential_of(SAMPLES[name]), 1, tmp_path)
        setup = Measured(scaled, 2.5 * a, shells, cell, potential, tmp_path)
        found = setup.correction
    assert found.left < 1e-9
    assert found.gradient is None
    assert np.abs(found.dA).max() < 0.03 * setup.traction


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("bent", [None, 0, 3], ids=["plain", "none bent", "bent"])
def test_products_and_normal_matrix_belong_to_one_matrix(dim: int, bent: int | None) -> None:
    """Also where no node has the neighbours that a gradient term needs."""
    rng = np.random.default_rng(8)
    G = [sparse.csr_array(rng.normal(size=(7, 4))) for _ in range(dim)]
    numbers = np.array(
        [
            [[min(i, j) * dim + max(i, j) + m for m in range(2)] for j in range(dim)]
            for i in range(dim)
        ]
    )
    bends = None if bent is None else sparse.csr_array(rng.normal(size=(4, bent)))
    system = correction.System(G, rng.uniform(1.0, 2.0, 7), numbers, bends)
    unknowns = system.of_pieces + (bent or 0) * dim * 2
    A = np.column_stack([system.forward(e) for e in np.eye(unknowns)])
    np.testing.assert_allclose(
        np.column_stack([system.backward(e) for e in np.eye(4 * dim * 2)]), A.T, atol=1e-13
    )
    np.testing.assert_allclose(system.normal().toarray(), A @ A.T, atol=1e-12)


@pytest.mark.parametrize(
    "box", [((-INF, 9.0), (-8.0, 9.8)), ((-8.0, 8.0), (-INF, 12.0)), ((-INF, 12.0), (-INF, 12.0))]
)
def test_uniform_strain_is_exact_where_planes_end_at_faces(box: Box) -> None:
    """What is left are errors of the differences, which need not be in balance."""
    setup = by_the_rule(lennard_jones(), 3.856, [box])
    assert setup.correction.left < 2e-9
    assert worst(setup) < 1e-8
    modulus = setup.crystal.tangent()[0, 0, 0, 0]
    assert np.abs(setup.correction.dA).max() < 0.06 * modulus


ODD_AT_FACE: Box = ((-INF, 10.0), (-8.0, 7.0))
"""An odd number of layers with cells of 5.1."""


@pytest.mark.parametrize(
    ("make", "cell", "box"),
    [
        (embedded, 3.856, ((-8.0, 8.0), (-INF, 12.0))),
        (embedded, 3.856, ((-INF, 12.0), (-INF, 12.0))),
        (lennard_jones, 5.1, ODD_AT_FACE),
        (embedded, 5.1, ODD_AT_FACE),
    ],
    ids=["C12 other than C44", "the same in a corner", "odd layers", "both"],
)
def test_strains_without_traction_are_exact_at_faces(
    make: Callable[[], Crystal], cell: float, box: Box
) -> None:
    """Within a cell of a face; elsewhere all strains. Others are nearly exact there."""
    setup = by_the_rule(make(), cell, [box])
    found = setup.correction
    assert found.gradient is None
    assert found.left < 2e-9
    assert 1e-4 < found.at_faces < 1e-2
    assert worst_without_traction(setup) < 1e-8
    modulus = setup.crystal.tangent()[0, 0, 0, 0]
    assert np.abs(found.dA).max() < 0.04 * modulus


def worst_without_traction(setup: Setup) -> float:
    """Largest force per unit strain, over the traction, where and when it should be zero."""
    d, faces = setup.crystal.dim, faces_met(setup.grid, setup.shells)
    strains, x, eye = unit_strains(d), setup.grid.positions(), np.eye(d)
    changes = np.stack(
        [nodal_forces(setup, eye + STEP * H) - nodal_forces(setup, eye - STEP * H) for H in strains]
    )
    worst_of_all = 0.0
    for close in product((False, True), repeat=len(faces)):
        here = correction.nodes_of_body(setup.grid)
        for face, yes in zip(faces, close, strict=True):
            here = here & (yes == (x[:, face.axis] < face.end + 1.01 * setup.cell))
        axes = [face.axis for face, yes in zip(faces, close, strict=True) if yes]
        tractions = setup.stresses[:, :, axes].reshape(len(strains), -1).T
        for number in null_space(tractions).T if axes else np.eye(len(strains)):
            change = np.einsum("m,mni->ni", number, changes)
            worst_of_all = max(worst_of_all, float(np.abs(change)[here].max(initial=0.0)))
    return worst_of_all / (2.0 * STEP * setup.traction * setup.cell ** (d - 1))


@pytest.mark.long
@pytest.mark.parametrize(
    ("make", "cell", "box"),
    [
        (copper, 2.5, ((-1.6, 1.6), (-1.6, 1.6), (-INF, 1.6))),
        (copper, 2.5, ((-INF, 1.6), (-1.6, 1.6), (-INF, 1.6))),
        (copper, 2.5, ((-INF, 1.6), (-INF, 1.6), (-INF, 1.6))),
        (copper_110, 2.5, ((-1.6, 1.6), (-1.6, 1.6), (-INF, 1.6))),
        (aluminium, 2.5, ((-1.6, 1.6), (-1.6, 1.6), (-INF, 1.6))),
        (iron, 3.0, ((-1.6, 1.6), (-1.6, 1.6), (-INF, 1.6))),
        (tungsten, 3.5, ((-1.6, 1.6), (-1.6, 1.6), (-INF, 1.6))),
    ],
)
def test_faces_of_metals(make: Callable[[], Crystal], cell: float, box: Box) -> None:
    """At a face, an edge and a corner of the body; lengths in lattice constants."""
    metal = make()
    a = metal.period[2]
    setup = by_the_rule(metal, cell * a, [tuple((low * a, high * a) for low, high in box)])
    assert setup.correction.left < 1e-10
    assert setup.correction.at_faces < 2e-2
    assert np.abs(setup.correction.dA).max() < 0.02 * setup.crystal.tangent()[0, 0, 0, 0]


def test_two_regions_are_corrected_together() -> None:
    assert by_the_rule(lennard_jones(), 3.0, PAIR).correction.left < 1e-10


def test_a_node_without_corrected_continuum_is_refused() -> None:
    setup = by_the_rule(lennard_jones(), 3.0, BOX)
    none = setup.corrected.take(np.zeros(len(setup.corrected.x), dtype=bool))
    with pytest.raises(BackendError, match="no continuum near it can be corrected"):
        correction.correct(
            setup.grid, none, setup.T, setup.residual(np.eye(2)), setup.changes, setup.stresses
        )


def test_weights_that_fluctuate_along_a_face_need_the_gradient_term() -> None:
    """Ghosts moved by plain hats, in a crystal with C12 other than C44."""
    soft = embedded()
    A = soft.tangent()
    assert abs(A[0, 0, 1, 1] - A[0, 1, 0, 1]) > 0.05 * A[0, 0, 0, 0]
    averaged = by_the_rule(soft, 3.0, BOX).correction
    assert averaged.gradient is None
    assert averaged.left < 1e-10
    setup = by_the_rule(replace(soft, period=np.zeros(2)), 3.0, BOX)
    assert setup.correction.gradient is not None
    assert worst(setup) < 1e-8


def test_a_correction_that_is_too_large_is_refused() -> None:
    setup = by_the_rule(lennard_jones(), 3.0, BOX)
    found = setup.correction
    correction.check_moduli(found, setup.stiffness)
    large = replace(found, dA=found.dA * (0.16 * setup.stiffness[0, 0] / np.abs(found.dA).max()))
    with pytest.raises(BackendError, match=r"other moduli by 0\.16 of C11"):
        correction.check_moduli(large, setup.stiffness)
    soft = replace(found, dA=np.tile(-0.3 * np.diag([0.0, 0.0, setup.stiffness[2, 2]]), (4, 1, 1)))
    with pytest.raises(BackendError, match=r"have 0\.7 of the crystal's stiffness"):
        correction.check_moduli(soft, setup.stiffness)


def test_a_force_that_nothing_balances_is_refused() -> None:
    setup = by_the_rule(lennard_jones(), 3.0, BOX)
    node = np.flatnonzero(setup.covered & correction.nodes_of_body(setup.grid))[20]
    changes = setup.changes.copy()
    changes[0, node, 0] += 1e-3 * setup.traction * setup.cell
    with pytest.raises(BackendError, match="of the traction is left at a node"):
        correction.correct(
            setup.grid, setup.corrected, setup.T, setup.residual(np.eye(2)), changes, setup.stresses
        )
