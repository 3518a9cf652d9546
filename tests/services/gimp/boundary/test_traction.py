"""Tractions: their nodal forces against exact integrals, and bodies that they load."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.boundary.traction import FACE_CONDITIONS, Traction
from gimpmd_gimp.setup import make_solver
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests.physics.gimp.bodies import body, step_all, total_energy

BOXES = {
    "1-D": ((6,), ()),
    "2-D": ((5, 3), ()),
    "3-D": ((3, 2, 4), ()),
    "2-D, levels": ((24, 16), ((((24, 48), (0, 20)),),)),
}
"""Cells, and boxes of finer levels; those reach the upper face of x and the lower one of y."""


def loaded(box: str, *conditions: Traction, **method) -> Solver:
    cells, finer = BOXES[box]
    free = (False,) * len(cells)
    choices = Method(**{"xpic_every": 0} | method)
    return body(
        cells, choices, 0.2, lambda p: None, periodic=free, finer=finer, conditions=conditions
    )


def impulse(solver: Solver, span: float = 1.0, time: float = 0.0) -> np.ndarray:
    """Impulse of the loads on the nodes, on all levels; hanging nodes give theirs away."""
    kick = Kick(0, solver.clock.levels, time, np.full(solver.top + 1, span))
    solver.stages.sum_loads(kick)
    return solver.nodes.loads.copy()


@pytest.mark.parametrize(
    ("box", "axis", "side"),
    [(box, axis, side) for box in BOXES for axis in range(len(BOXES[box][0])) for side in (0, 1)],
)
def test_the_force_and_its_moments_are_exact(box, axis, side) -> None:
    """``sum_i f_i = t A`` and ``sum_i f_i x_i = t int x dA``, edges and corners included."""
    dim = len(BOXES[box][0])
    value = (0.3, -0.2, 0.5)[:dim]
    solver = loaded(box, Traction(axis, side, value, lambda _: 1.0))
    J, x = impulse(solver), solver.mesh.positions()
    size = np.array(BOXES[box][0], dtype=float)
    area = np.delete(size, axis).prod()
    np.testing.assert_allclose(J.sum(axis=0), area * np.array(value), rtol=1e-13)
    centre = 0.5 * size
    centre[axis] = side * size[axis]
    moments = np.einsum("ni,nj->ij", J, x)
    np.testing.assert_allclose(moments, area * np.outer(value, centre), atol=1e-12)
    # a hat function is one of a half-width of 1e-9, which leaves a quarter of that beside the face
    loaded_nodes = np.abs(J).max(axis=1) > 1e-9
    np.testing.assert_array_equal(x[loaded_nodes, axis], side * size[axis])


def test_nodes_of_a_face_share_it_as_hat_functions_do() -> None:
    """A node has a whole cell of the face, and a node at a corner half a cell."""
    solver = loaded("2-D", Traction(0, 1, (2.0, 0.0), lambda _: 1.0))
    J, x = impulse(solver), solver.mesh.positions()
    for y, share in ((0, 0.5), (1, 1.0), (2, 1.0), (3, 0.5)):
        (node,) = np.flatnonzero((x == (5.0, y)).all(axis=1))
        assert J[node, 0] == pytest.approx(2.0 * share, rel=1e-9)


@pytest.mark.parametrize("configuration", ["current", "reference"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("box", ["1-D", "2-D", "3-D", "2-D, levels"])
def test_momentum_is_the_sum_over_the_kicks(box, integrator, configuration) -> None:
    """A constant traction gives ``t A`` times the present time."""
    # on the grid a face may not move off its line of nodes by much
    pull = 1e-9 if configuration == "current" else 1e-2
    dim = len(BOXES[box][0])
    value = (pull, -0.5 * pull, 0.2 * pull)[:dim]
    load = Traction(0, 1, value, lambda _: 1.0)
    solver = loaded(box, load, integrator=integrator, configuration=configuration)
    for _ in range(3):
        step_all(solver)
    area = float(np.prod(BOXES[box][0][1:]))
    exact = area * solver.time * np.array(value)
    assert solver.energies()[3:] == pytest.approx(exact, rel=1e-9)


def test_the_factor_is_that_of_the_time_of_the_kick() -> None:
    solver = loaded("2-D", Traction(1, 0, (0.0, 1.0), lambda time: time**2))
    total = impulse(solver, span=0.5, time=3.0).sum(axis=0)
    np.testing.assert_allclose(total, [0.0, 5.0 * 0.5 * 9.0], atol=1e-13)


def test_stress_of_the_case_becomes_force_per_area() -> None:
    """In metal units a bar is (g/mol) / (A ps^2) times a factor; components left out are free."""
    face = Face(condition="traction", value=(None, 2.0), ramp=4.0)
    (made,) = FACE_CONDITIONS["traction"](0, 1, face, UNITS["metal"])
    solver = loaded("2-D", made)
    total = impulse(solver, time=1.0).sum(axis=0)
    unit = 2.0 / UNITS["metal"].nktv2p / UNITS["metal"].mvv2e  # pressure, energy
    np.testing.assert_allclose(total, [0.0, 3.0 * unit * 0.25], rtol=1e-12, atol=1e-20)
    assert FACE_CONDITIONS["free"](0, 1, face, UNITS["metal"]) == []


def test_traction_stretches_a_bar_to_the_exact_static_strain(build):
    """Slow tension between symmetry planes; static strain is traction / C11."""
    case = build(
        domain={"box": [[0.0, 8.0], [0.0, 2.0]], "periodic": [False, True]},
        md={"region": [[0.0, 8.0], [0.0, 2.0]], "input": "none.in"},
        boundary={
            "left": {"condition": "symmetry"},
            "right": {"condition": "traction", "value": [1e-3, 0.0], "ramp": 640.0},
        },
        time={"end": 1.0, "md_timestep": 0.4, "md_steps": 1},
    )
    solver = make_solver(make_plan(case))
    while solver.time < 800.0:
        solver.step()
    # inertia leaves a ripple of the order of period / ramp, about 32 / 640 of 1 / pi
    assert solver.points.strain[:, 0] == pytest.approx(1e-3, rel=0.02)
    assert np.abs(solver.points.strain[:, 1:]).max() < 1e-12
    assert total_energy(solver) == pytest.approx(solver.work.external, rel=2e-3)


def test_momentum_of_a_free_body_is_what_the_traction_gave(build):
    case = build(
        domain={"box": [[0.0, 32.0], [0.0, 4.0]]},
        boundary={"right": {"condition": "traction", "value": [1e-3, 2e-3]}},
    )
    solver = make_solver(make_plan(case))
    for _ in range(50):
        solver.step()
    momentum = solver.points.mass @ solver.points.v
    impulse = 50 * solver.dt
    # the moving edge gives nodes just outside a little load that no mass answers
    assert momentum == pytest.approx(4.0 * impulse * np.array([1e-3, 2e-3]), rel=1e-8)
