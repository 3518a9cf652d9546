"""Finite elements against scikit-fem's own matrices, exact solutions, and forces of atoms."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from skfem import Basis, ElementHex1, ElementQuad1, ElementVector, MeshHex, MeshQuad, asm
from skfem.models.elasticity import linear_elasticity

from gimpmd_deploy.results.points import PointsFile
from gimpmd_gimp.fem.fem import Fem
from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.checkpoint.manifest import folder_of, state_file
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD
from tests.services.gimp.coupling.test_force import case_of, push

LAME, SHEAR = 1.5, 1.0
MODULI = {"from": "moduli", "density": 2.0, "lame": LAME, "shear": SHEAR}
FINITE = MODULI | {"model": "neo-hookean"}


def plan_of(cells: tuple[int, ...], **changes: Any) -> Plan:
    """A box of unit cells without atoms."""
    case = {
        "gimpmd": 1,
        "name": "fem",
        "units": "lj",
        "domain": {"box": [[0, n] for n in cells]},
        "grid": {"cell": 1},
        "time": {"end": 10, "step": 0.2},
        "continuum": {"backend": "fem", "material": MODULI},
        "output": {"interval": 10},
        "only": "continuum",
    }
    for key, value in changes.items():
        *parents, last = key.split("__")
        place: Any = case
        for parent in parents:
            place = place[parent]
        place[last] = value
    return make_plan(msgspec.convert(case, Case))


def columns(plan: Plan) -> np.ndarray:
    """Ids on the shared grid of the vertices of scikit-fem's mesh of the box."""
    grid = plan.background_grid()
    vertices = mesh_of(plan).p.T
    return np.ravel_multi_index(tuple(np.rint(vertices).astype(int).T + PAD), grid.shape)


def mesh_of(plan: Plan) -> Any:
    axes = [np.arange(high + 1.0) for _, high in plan.domain.box]
    return {2: MeshQuad, 3: MeshHex}[plan.dim].init_tensor(*axes)


@pytest.mark.parametrize("cells", [(3, 2), (2, 3, 2)])
def test_small_forces_are_those_of_scikit_fem(tmp_path: Path, cells: tuple[int, ...]) -> None:
    """Linear elasticity at random displacements: the stiffness matrix that scikit-fem assembles."""
    plan = plan_of(cells)
    code, ids = Fem(plan, None, tmp_path), columns(plan)
    element = {2: ElementQuad1, 3: ElementHex1}[plan.dim]()
    basis = Basis(mesh_of(plan), ElementVector(element), intorder=3)
    stiffness = asm(linear_elasticity(LAME, SHEAR), basis)
    u = np.random.default_rng(1).normal(size=(ids.size, plan.dim))
    code._u[ids] = u
    code._deform()
    force = np.zeros(basis.N)
    force[basis.nodal_dofs] = code._internal[ids].T
    flat = np.zeros(basis.N)
    flat[basis.nodal_dofs] = u.T
    np.testing.assert_allclose(force, -stiffness @ flat, atol=1e-12 * np.abs(force).max())
    assert code.note_energies() == pytest.approx(0.5 * flat @ stiffness @ flat, rel=1e-12)
    assert code._mass.sum() == pytest.approx(2.0 * np.prod(cells), rel=1e-13)
    code.close()


@pytest.mark.parametrize("cells", [(3, 3), (3, 2, 2)])
def test_a_large_uniform_deformation_is_exact(tmp_path: Path, cells: tuple[int, ...]) -> None:
    """Neo-Hookean: no force inside, the traction ``P n`` on a face, and the energy in closed form.

    ``P = mu (F - F^-T) + lambda ln J F^-T``; a rotation alone has no stress (Bonet and Wood).
    """
    plan = plan_of(cells, continuum__material=FINITE)
    code, ids, dim = Fem(plan, None, tmp_path), columns(plan), plan.dim
    F = np.eye(dim) + 0.3 * np.random.default_rng(2).uniform(-1, 1, (dim, dim))
    x = code.positions(ids)
    rotation = np.linalg.qr(F)[0]
    rotation[:, 0] *= np.linalg.det(rotation)  # no reflection
    for gradient in (F, rotation):
        code._u[ids] = x @ (gradient - np.eye(dim)).T
        code._deform()
        inner = ((x > 0.5) & (x < np.array(cells) - 0.5)).all(axis=1)
        np.testing.assert_allclose(code._internal[ids][inner], 0.0, atol=1e-13)
        J, inverse = np.linalg.det(gradient), np.linalg.inv(gradient)
        P = SHEAR * (gradient - inverse.T) + LAME * np.log(J) * inverse.T
        right = x[:, 0] > cells[0] - 0.5
        pull = -code._internal[ids][right].sum(axis=0)
        area = float(np.prod(cells[1:]))
        np.testing.assert_allclose(pull, area * P[:, 0], atol=1e-12)
        trace = np.trace(gradient.T @ gradient)
        W = 0.5 * SHEAR * (trace - dim) - SHEAR * np.log(J) + 0.5 * LAME * np.log(J) ** 2
        assert code.note_energies() == pytest.approx(W * np.prod(cells), rel=1e-11, abs=1e-12)
    code.close()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_frequency_of_a_standing_wave_is_exact(tmp_path: Path, dim: int) -> None:
    """Lumped linear elements and leapfrog steps: ``sin(w dt/2) = (c dt/h) sin(k h/2)``.

    The velocity at a whole step is the mean of those before and after it, which is smaller than the
    rate of the displacement by the cosine of ``w dt/2``.
    """
    cells, n = (16, *([2] * (dim - 1))), 16
    plan = plan_of(cells, domain__periodic=[True] * dim)
    code = Fem(plan, None, tmp_path)
    side = ContinuumSide(plan, code)
    k, c = 2.0 * np.pi / n, np.sqrt((LAME + 2.0 * SHEAR) / 2.0)
    ids = np.flatnonzero(code._mass)
    code._v[ids, 0] = 1e-3 * np.cos(k * code.positions(ids)[:, 0])
    side.finish()
    first = side.energies()
    assert first is not None
    omega = 2.0 / plan.step * np.arcsin(c * plan.step * np.sin(0.5 * k))
    for _ in range(40):
        side.advance()
        side.finish()
        found = side.energies()
        assert found is not None
        phase = omega * code.steps * plan.step
        potential = np.sin(phase) ** 2 / np.cos(0.5 * omega * plan.step) ** 2
        exact = first.kinetic * np.array([np.cos(phase) ** 2, potential])
        found = [found.kinetic, found.potential]
        np.testing.assert_allclose(found, exact, atol=1e-10 * first.kinetic)
    side.close()


def bar(**changes: Any) -> Plan:
    return plan_of((20, 3), domain__periodic=[False, True], **changes)


@pytest.mark.parametrize(
    ("right", "impulse"),
    [
        ({"condition": "traction", "value": [0.01, 0.004], "ramp": 1.0}, True),
        ({"condition": "velocity", "value": [0.01, None], "ramp": 1.0}, False),
        ({"condition": "displacement", "value": [0.05, None], "ramp": 5.0}, False),
    ],
    ids=["traction", "velocity", "displacement"],
)
def test_the_work_of_a_face_is_the_energy(
    tmp_path: Path, right: dict[str, Any], impulse: bool
) -> None:
    boundary = {"left": {"condition": "symmetry"}, "right": right}
    plan = bar(boundary=boundary, continuum__material=FINITE)
    side = ContinuumSide(plan, code := Fem(plan, None, tmp_path))
    for _ in range(30):  # the wave has not come back: t = 6, c = 1.3
        side.advance()
        side.finish()
    found = side.energies()
    assert found is not None
    assert found.external_work > 0.0
    assert found.kinetic + found.potential == pytest.approx(found.external_work, rel=1e-2)
    if impulse:
        assert found.momentum == pytest.approx(np.array([0.01, 0.004]) * 3 * (6.0 - 0.5), rel=1e-9)
    elif right["condition"] == "displacement":
        face = code._nodes[:, 0] == 20.0
        np.testing.assert_allclose(code._u[face & (code._mass > 0), 0], 0.05, rtol=1e-9)
    side.close()


def test_points_are_written_with_the_fields_of_material_points(tmp_path: Path) -> None:
    gradient = [[0.01, 0.0], [0.0, 0.0]]
    for code in (Fem, Gimp):
        folder = tmp_path / code.__name__
        (folder / "fields").mkdir(parents=True)
        made = code(bar(initial={"stretch": {"gradient": gradient}}), None, folder)
        made.write(0.0)
        made.close()
    mine, gimp = (
        PointsFile(tmp_path / name / "fields" / "points.vtkhdf").read(0) for name in ("Fem", "Gimp")
    )
    assert set(mine.fields) == set(gimp.fields)
    np.testing.assert_allclose(mine.stress, np.tile([0.035, 0.015, 0.0], (len(mine), 1)), atol=1e-9)
    np.testing.assert_allclose(mine.displacement[:, 0], 0.01 * mine.reference[:, 0], atol=1e-9)
    assert mine.fields["mass"].sum() == pytest.approx(gimp.fields["mass"].sum())
    # the boxes fill the body, as the material points do
    order = [np.lexsort(points.reference.round(6).T) for points in (mine, gimp)]
    np.testing.assert_allclose(mine.reference[order[0]], gimp.reference[order[1]])
    np.testing.assert_allclose(mine.size, gimp.size)


def test_a_run_goes_on_from_a_checkpoint_with_the_same_bits(tmp_path: Path) -> None:
    boundary = {"right": {"condition": "traction", "value": [0.01, 0.004], "ramp": 1.0}}
    plan = bar(boundary=boundary, continuum__material=FINITE)
    side = ContinuumSide(plan, Fem(plan, None, tmp_path))

    def go_on(side: ContinuumSide) -> None:
        for _ in range(5):
            side.advance()
            side.finish()
        side.write(1.0)
        side.renew()

    side.write(0.0)
    go_on(side)
    save_state(tmp_path, 5, "continuum", 0, side.state())
    shutil.copytree(tmp_path / "fields", tmp_path / "other" / "fields")
    go_on(side)
    other = ContinuumSide(plan, Fem(plan, None, tmp_path / "other"))
    path = folder_of(tmp_path, 5) / state_file("continuum", 0)
    other.restore(SavedStates(5, (path,), 0, 1))
    go_on(other)
    for name, array in side.state().items():
        assert array.tobytes() == other.state()[name].tobytes(), name
    side.close()
    other.close()
    files = [PointsFile(tmp_path / name / "fields/points.vtkhdf") for name in (".", "other")]
    assert [len(file.times) for file in files] == [3, 3]
    np.testing.assert_array_equal(files[0].read(2).stress, files[1].read(2).stress)


@pytest.fixture
def coupled(tmp_path: Path) -> Callable[[Any], ContinuumSide]:
    (tmp_path / "fields").mkdir()
    return lambda code: ContinuumSide(plan := make_plan(case_of(0)), code(plan, None, tmp_path))


def test_the_work_of_the_atoms_is_the_energy(coupled: Callable[[Any], ContinuumSide]) -> None:
    """Atoms pull at the nodes along a plane that crosses elements; GIMP moves alike."""
    moved = []
    for code in (Fem, Gimp):
        side = coupled(code)
        force = np.zeros((side.needs.size, 2))
        force[:, 0] = -3.0
        first, *_, last = push(side, [min(step / 30, 1.0) * force for step in range(61)])
        gained = last.kinetic + last.potential - first.kinetic - first.potential
        assert last.interface_work > 0.0
        assert gained == pytest.approx(last.interface_work, rel=1e-2)
        moved.append(side.zone_fields()["velocity"][:, 0].mean())
        side.close()
    fem, gimp = moved
    assert fem == pytest.approx(gimp, rel=0.05)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boundary": {"left": {"condition": "absorbing"}}}, "boundary.left.condition = 'absorb"),
        ({"continuum__ranks": 2}, "continuum.ranks: continuum.backend: fem has none of this"),
        ({"continuum__flip": 0.9}, "continuum.flip: continuum.backend: fem has none of this"),
        (
            {"continuum__material": {**MODULI, "from": "j2", "yield_stress": 0.1}},
            "has history variables; continuum.backend: fem is elastic",
        ),
    ],
)
def test_what_only_gimp_can_do_is_refused(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(BackendError, match=words):
        Fem(plan_of((8, 8), **changes), None, tmp_path)


def test_a_body_that_becomes_unstable_ends_the_run(tmp_path: Path) -> None:
    plan = plan_of((4, 4), time__step=3.0, time__end=900)
    code = Fem(plan, None, tmp_path)
    code._v[code._mass > 0] = np.random.default_rng(3).normal(size=(25, 2))

    def steps() -> None:
        for _ in range(1000):
            code.start_step()
            code.end_step()

    unstable = pytest.raises(BackendError, match="the finite elements became unstable in step")
    with unstable, np.errstate(all="ignore"):
        steps()
    code.close()
