"""Elements of a mesh against the matrices of scikit-fem, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh
from skfem import Basis, ElementVector, asm
from skfem.models.elasticity import linear_elasticity

from gimpmd_gimp.fem.mesh_elements import MeshPart, make_part
from gimpmd_gimp.fem.mesh_file import read_mesh
from gimpmd_schemas.mechanics.elasticity import isotropic
from tests.services.gimp.fem.meshes import block

LAME, SHEAR, DENSITY = 1.5, 1.0, 2.0
KINDS = {"quad": (4, 3), "triangle": (4, 3), "hexahedron": (2, 2, 2), "tetra": (2, 2, 2)}


@pytest.fixture(params=KINDS)
def part(request, tmp_path) -> MeshPart:
    kind, cells = request.param, KINDS[request.param]
    block(tmp_path / "m.vtu", cells, kind)
    file = read_mesh(tmp_path, "m.vtu", len(cells))
    return make_part(kind, file.x, file.cells[kind], np.arange(len(file.x)), len(file.x))


def test_no_element_is_folded_and_all_fill_the_block(part: MeshPart) -> None:
    assert part.folded().size == 0
    assert part.volume() == pytest.approx(np.round(np.ptp(part.mesh.p, axis=1)).prod(), rel=1e-12)


def test_no_vibration_of_the_body_is_faster_than_those_of_its_elements(part: MeshPart) -> None:
    """All vibrations of the body, with the matrices of scikit-fem; the bound is not far off."""
    dim = part.mesh.p.shape[0]
    basis = Basis(part.mesh, ElementVector(part.element), intorder=part.order)
    K = asm(linear_elasticity(LAME, SHEAR), basis).toarray()
    lumped = np.empty(basis.N)
    lumped[basis.nodal_dofs] = part.elements(1.0).lumped_mass(DENSITY)
    fastest = np.sqrt(eigh(K, np.diag(lumped), eigvals_only=True)[-1])
    bound = part.frequencies(isotropic(LAME, SHEAR, dim), DENSITY).max()
    assert 0.5 * bound < fastest <= bound * (1.0 + 1e-9)


def test_the_frequency_of_a_square_element_is_exact() -> None:
    """Two opposite edges of a square of unit mass move against each other: ``w = 2 c / h``.

    With Lame's lambda zero the stiffest motions are such stretches, or slower ones.
    """
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    part = make_part("quad", x, np.array([[0, 1, 2, 3]]), np.arange(4), 4)
    (omega,) = part.frequencies(isotropic(0.0, 0.5, 2), 1.0)
    assert omega == pytest.approx(2.0, rel=1e-12)


def test_a_folded_element_is_found() -> None:
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]])  # not convex
    part = make_part("quad", x, np.array([[0, 1, 2, 3]]), np.arange(4), 4)
    assert part.folded().tolist() == [0]


def test_points_on_a_face_carry_its_area_and_its_moments(part: MeshPart) -> None:
    size = np.round(part.mesh.p.max(axis=1))
    points = part.face_points(0, float(size[0]), 1e-6)
    assert points.area.sum() == pytest.approx(size[1:].prod(), rel=1e-12)
    nodal = points.values.T @ points.area
    np.testing.assert_allclose(nodal @ part.mesh.p.T, points.area @ points.x, rtol=1e-12)
    assert nodal @ part.mesh.p[1] == pytest.approx(size[1:].prod() * size[1] / 2, rel=1e-12)
    assert part.face_points(0, 0.5, 1e-6).area.size == 0
