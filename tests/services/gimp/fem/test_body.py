"""Bodies with a mesh from a file: exact solutions, energy, and bodies around a box of atoms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import msgspec
import numpy as np
import pytest

from gimpmd_coupler.check.peers import Ideal
from gimpmd_deploy.results.points import PointsFile
from gimpmd_gimp.fem.fem import Fem
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import BackendError
from tests.physics.lattice import SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import ROWS, lj_crystal
from tests.services.gimp.coupling.test_force import SUMS, H, push
from tests.services.gimp.fem.meshes import around, block
from tests.services.gimp.fem.test_fem import FINITE, LAME, SHEAR, plan_of

STRAIN = 1e-6
"""The correction near the planes is exact to first order in the strain."""

STRETCH = STRAIN * np.array([[1.0, 0.5], [-0.25, 0.75]])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "input").mkdir()
    (tmp_path / "fields").mkdir()
    return tmp_path


@pytest.mark.parametrize("kind", ["quad", "triangle", "hexahedron", "tetra"])
def test_a_large_uniform_deformation_is_exact(folder: Path, kind: str) -> None:
    """Neo-Hookean on an irregular mesh: no force inside, and the traction ``P n`` on a face."""
    cells = (4, 3) if kind in ("quad", "triangle") else (3, 3, 2)
    block(folder / "input" / "block.vtu", cells, kind)
    plan = plan_of(cells, continuum__mesh="block.vtu", continuum__material=FINITE)
    code, dim = Fem(plan, None, folder), plan.dim
    assert code._mass.sum() == pytest.approx(2.0 * np.prod(cells), rel=1e-12)
    F = np.eye(dim) + 0.2 * np.random.default_rng(2).uniform(-1, 1, (dim, dim))
    x = code._nodes
    code._u[:] = x @ (F - np.eye(dim)).T
    code._deform()
    inner = ((x > 1e-9) & (x < np.array(cells) - 1e-9)).all(axis=1)
    assert inner.any()
    np.testing.assert_allclose(code._internal[inner], 0.0, atol=1e-13)
    J, inverse = np.linalg.det(F), np.linalg.inv(F)
    P = SHEAR * (F - inverse.T) + LAME * np.log(J) * inverse.T
    pull = -code._internal[x[:, 0] > cells[0] - 1e-9].sum(axis=0)
    np.testing.assert_allclose(pull, np.prod(cells[1:]) * P[:, 0], atol=1e-12)
    code.close()


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_the_work_of_a_face_is_the_energy(folder: Path, kind: str) -> None:
    """A traction on a part of a face; its force is that of the traction, whatever the mesh."""
    block(folder / "input" / "bar.msh", (20, 3), kind)
    right = [{"extent": [[0, 2]], "condition": "traction", "value": [0.01, 0.004], "ramp": 1.0}]
    plan = plan_of(
        (20, 3),
        continuum__mesh="bar.msh",
        continuum__material=FINITE,
        time__step=0.1,
        boundary={"left": {"condition": "symmetry"}, "right": right},
    )
    side = ContinuumSide(plan, Fem(plan, None, folder))
    for _ in range(60):  # the wave has not come back: t = 6, c = 1.3
        side.advance()
        side.finish()
    found = side.energies()
    assert found is not None
    assert found.kinetic + found.potential == pytest.approx(found.external_work, rel=1e-2)
    assert found.momentum == pytest.approx(np.array([0.01, 0.004]) * 2 * (6.0 - 0.5), rel=1e-9)
    side.close()


def test_a_periodic_mesh_has_no_faces(folder: Path) -> None:
    """A uniform shear across the periodic faces: no force anywhere but at the free faces."""
    block(folder / "input" / "strip.vtu", (4, 3), "quad")
    plan = plan_of((4, 3), continuum__mesh="strip.vtu", domain__periodic=[False, True])
    code = Fem(plan, None, folder)
    assert code._mass.size == 5 * 3
    code._u[:, 1] = 0.01 * code._nodes[:, 0]
    code._deform()
    inner = (code._nodes[:, 0] > 1e-9) & (code._nodes[:, 0] < 4 - 1e-9)
    np.testing.assert_allclose(code._internal[inner], 0.0, atol=1e-15)
    code.close()


def test_boxes_of_points_fill_rectangles(folder: Path) -> None:
    """Output of two rectangles, 3 x 2 and 1 x 2: four boxes each, with the displacements there."""
    x = [[0, 0, 0], [3, 0, 0], [4, 0, 0], [0, 2, 0], [3, 2, 0], [4, 2, 0]]
    mesh = meshio.Mesh(np.array(x, float), [("quad", [[0, 1, 4, 3], [1, 2, 5, 4]])])
    mesh.write(folder / "input" / "two.vtu")
    gradient = ((0.01, 0.0), (0.0, 0.0))
    plan = plan_of((4, 2), continuum__mesh="two.vtu", initial={"stretch": {"gradient": gradient}})
    code = Fem(plan, None, folder)
    code.write(0.0)
    code.close()
    points = PointsFile(folder / "fields" / "points.vtkhdf").read(0)
    order = np.lexsort(points.reference.T[::-1].round(6))
    wide, narrow = [1.5, 1.0], [0.5, 1.0]
    np.testing.assert_allclose(points.size[order], [wide] * 4 + [narrow] * 4)
    places = [[cx, cy] for cx in (0.75, 2.25, 3.25, 3.75) for cy in (0.5, 1.5)]
    np.testing.assert_allclose(points.reference[order], places)
    np.testing.assert_allclose(points.displacement[:, 0], 0.01 * points.reference[:, 0])


def test_the_fastest_element_limits_the_step(folder: Path) -> None:
    block(folder / "input" / "m.vtu", (6, 6), "quad")
    with pytest.raises(BackendError, match=r"time.step: steps of 0.8 are unstable in continuum"):
        Fem(plan_of((6, 6), continuum__mesh="m.vtu", time__step=0.8), None, folder)
    Fem(plan_of((6, 6), continuum__mesh="m.vtu", time__step=0.4), None, folder).close()


# --- around a box of atoms -----------------------------------------------------------------------


def boxed(mesh: str | None, **changes: Any) -> Plan:
    """The plan of `boxed_case`."""
    return make_plan(boxed_case(mesh, **changes))


def boxed_case(mesh: str | None, **changes: Any) -> Case:
    """A box of atoms in the middle of a body, with planes on its four sides."""
    planes = {
        "left": 20.5 * SPACING, "right": 30.5 * SPACING,
        "bottom": 20.0 * ROWS, "top": 32.0 * ROWS,
    }  # fmt: skip
    region = [
        [planes["left"] - 3.0, planes["right"] + 3.0],
        [planes["bottom"] - 3.0, planes["top"] + 3.0],
    ]
    case = {
        "gimpmd": 1,
        "name": "boxed",
        "units": "lj",
        "domain": {"box": [[0.0, 26 * H], [0.0, 24 * H]]},
        "grid": {"cell": H},
        "time": {"end": 4.0, "md_timestep": 0.002, "md_steps": 20},
        "md": {"region": region, "input": "none.in"},
        "continuum": {
            "backend": "fem",
            "mesh": mesh,
            "material": {"from": "moduli", "density": 1.0, "lame": 1.0, "shear": 1.0},
        },
        "coupling": {"scheme": "force", "planes": planes},
        "output": {"interval": 4.0},
        **changes,
    }
    made = msgspec.convert(case, Case)
    crystal = lj_crystal((0.25 * SPACING, 0.5 * ROWS))
    replace = msgspec.structs.replace
    return replace(
        made,
        coupling=replace(made.coupling, crystal=crystal),
        continuum=replace(made.continuum, material=SUMS),
    )


OUTER = ((0.0, 26 * H), (0.0, 24 * H))
INNER = ((8 * H, 18 * H), (6 * H, 16 * H))


def around_atoms(folder: Path, **changes: Any) -> None:
    around(folder / "input" / "ring.vtu", OUTER, INNER, H, **{"shake": 0.2, **changes})


@pytest.mark.parametrize("growth", [None, 1.05, 1.4])
def test_uniform_strain_passes_the_corners_and_the_mesh(folder: Path, growth: float | None) -> None:
    """The crystal strained uniformly pulls at the ghosts; no node moves. None: without a mesh."""
    if growth is not None:
        around_atoms(folder, growth=growth)
    held = {"condition": "velocity", "value": [0.0, 0.0]}
    plan = boxed(
        "ring.vtu" if growth else None,
        boundary=dict.fromkeys(("left", "right", "bottom", "top"), held),
        initial={"stretch": {"gradient": STRETCH.tolist()}},
    )
    code = Fem(plan, None, folder)
    side = ContinuumSide(plan, code)
    pull = Ideal(plan, "continuum", side.needs).strained(STRETCH)(0)
    for _ in range(10):
        side.finish()
        side.receive(pull)
        side.advance()
    side.close()
    assert np.abs(code._v).max() < 1e-5 * STRAIN * plan.wave_speed("P")


def test_the_work_of_the_atoms_is_the_energy(folder: Path) -> None:
    """Atoms pull at the nodes around their box; two runs have the same bits."""
    around_atoms(folder, growth=1.1)
    plan = boxed("ring.vtu")
    gained, bits = [], []
    for _ in range(2):
        side = ContinuumSide(plan, Fem(plan, None, folder))
        pull = Ideal(plan, "continuum", side.needs).strained(np.zeros((2, 2)))(0)["force"]
        rng = np.random.default_rng(1)
        push_of = 0.3 * rng.uniform(-1, 1, pull.shape)
        forces = [pull + min(step / 30, 1.0) * push_of for step in range(61)]
        first, *_, last = push(side, forces)
        gained.append(last.kinetic + last.potential - first.kinetic - first.potential)
        bits.append([array.tobytes() for array in side.state().values()])
        side.close()
    assert last.interface_work > 0.0
    assert gained[0] == pytest.approx(last.interface_work, rel=1e-3)
    assert bits[0] == bits[1]
