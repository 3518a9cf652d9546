"""GIMP as a continuum code: nodes of the shared grid, forces from outside, energies, output."""

from __future__ import annotations

from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from gimpmd_gimp.gimp import Gimp
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from tests.cases import BAR, CONTINUUM_ONLY, changed

ALONE = CONTINUUM_ONLY | {"continuum.threads": 1, "domain": {"box": [[0, 24], [0, 8]]}}
COUPLED = {
    "only": None,
    "continuum.threads": 1,
    "domain": {"box": [[0, 32], [0, 16]]},
    "md": {"region": [[20, 32], [0, 16]], "input": "none.in"},
}


def plan_of(changes: dict) -> Plan:
    return make_plan(msgspec.convert(changed(BAR, changes), Case))


def make(run_dir: Path, **changes) -> Gimp:
    return Gimp(plan_of(ALONE | changes), None, run_dir)


def folder(parent: Path, number: int) -> Path:
    """A run folder of its own."""
    made = parent / str(number)
    made.mkdir()
    return made


def shake(code: Gimp) -> None:
    """A smooth motion of both components."""
    p = code.solver.points
    phase = np.pi / 12.0 * p.reference
    p.v[:] = 0.01 * np.sin(phase) + 0.02 * np.cos(phase[:, ::-1])


def step(code: Gimp) -> None:
    code.start_step()
    code.end_step()


FINER = {"grid.levels": [{"boxes": [[[8, 16], [0, 8]]]}]}
PULL = {"right": {"condition": "traction", "value": [1e-2, 5e-3], "ramp": 2.0}}
LEAPFROG = {
    "continuum.configuration": "reference",
    "continuum.integrator": "musl",
    "boundary": PULL,
}
"""Whose kicks have their middle at the time of ``note_energies``."""


@pytest.mark.parametrize("levels", [{}, FINER], ids=["one level", "two levels"])
def test_noted_energies_are_the_exact_ones_of_that_time(tmp_path, levels) -> None:
    """A twin computes them at once, with a part of the next kick."""
    noting, twin = (make(folder(tmp_path, i), **LEAPFROG, **levels) for i in range(2))
    for code in (noting, twin):
        shake(code)
    for number in range(4):
        strain = noting.note_energies()
        exact = twin.present_energies()
        assert strain == pytest.approx(exact.potential, rel=1e-12)
        for sub_step in range(2 ** len(levels)):
            step(noting)
            step(twin)
            if sub_step == 0:  # the kick of all levels comes first
                noted = noting.noted_energies()
        assert noted.kinetic == pytest.approx(exact.kinetic, rel=1e-9)
        assert noted.momentum == pytest.approx(exact.momentum, rel=1e-9)
        assert noted.mass == pytest.approx(24.0 * 8.0, rel=1e-13)
        assert noted.interface_work == noted.dissipated == 0.0
        if number == 0:
            assert noted.external_work == exact.external_work == 0.0
    noting.close()
    twin.close()


def test_noted_energies_balance(tmp_path) -> None:
    """Energies less the external work stay those of the start, to second order of the step."""
    errors = []
    for number, dt in enumerate((0.4, 0.2)):
        code = make(folder(tmp_path, number), **LEAPFROG, time={"end": 100, "step": dt})
        shake(code)
        balance = []
        while code.steps * dt < 20.0:
            code.note_energies()
            step(code)
            noted = code.noted_energies()
            balance.append(noted.kinetic + noted.potential - noted.external_work)
        code.close()
        assert abs(noted.external_work) > 0.05 * balance[0]
        errors.append(np.abs(np.array(balance) / balance[0] - 1.0).max())
    assert errors[0] < 0.05
    assert errors[1] < 0.3 * errors[0]


def test_energies_that_nobody_noted_are_an_error(tmp_path) -> None:
    code = make(tmp_path)
    step(code)
    with pytest.raises(ValueError, match="no energies have been noted"):
        code.noted_energies()
    code.close()


def test_forces_from_outside_move_the_node_that_they_act_on(tmp_path) -> None:
    code = Gimp(plan_of(COUPLED), None, tmp_path)
    grid = plan_of(COUPLED).background_grid()
    place = np.array([[10.0, 7.0]])
    (number,) = np.flatnonzero((grid.positions() == place).all(axis=1))
    (row,) = code.rows(np.array([number]))
    assert code.positions(np.array([row])).tolist() == place.tolist()
    assert code.counted(np.array([row])).all()

    def push(span: float, J: np.ndarray) -> None:
        J[row] += span * np.array([0.0, 2e-3])

    code.add_nodal_forces(push)
    step(code)
    moved = np.argmax(np.abs(code.solver.V[:, 1]))
    assert moved == row
    np.testing.assert_array_equal(code.velocity(np.array([row])), code.solver.V[[row]])
    assert code.solver.points.mass @ code.solver.points.v[:, 1] == pytest.approx(
        2e-3 * code.solver.clock.velocity_time[0], rel=1e-12
    )
    code.close()


def test_rows_of_the_shared_grid_stand_at_the_same_places(tmp_path) -> None:
    """Where there is no continuum, at nodes deep among the atoms, there may be no row."""
    code, grid = Gimp(plan_of(COUPLED), None, tmp_path), plan_of(COUPLED).background_grid()
    ids = np.arange(grid.size)
    rows = code.rows(ids)
    x = grid.positions()
    inside = ((x >= 0.0) & (x <= (32.0, 16.0))).all(axis=1)
    assert (rows[inside] >= 0).all()
    known = rows >= 0
    np.testing.assert_array_equal(code.positions(rows[known]), x[known])
    assert code.owns(x[inside]).all()
    code.close()


def test_a_run_without_atoms_has_no_shared_grid(tmp_path) -> None:
    code = make(tmp_path)
    with pytest.raises(ValueError, match="without atoms has no shared grid"):
        code.rows(np.array([0]))
    code.close()


def test_what_the_log_and_the_record_say(tmp_path) -> None:
    """A layer of coarse points on both sides of the finer level has joined it, 16 points each."""
    code = make(tmp_path, **FINER)
    assert code.version().startswith("gimp ")
    p, mesh = code.solver.points, code.solver.mesh
    assert code.summary() == (
        f"rank 0 of 1; level 0: 480 material points, {(mesh.level == 0).sum():,} nodes; "
        f"level 1: 1,056 material points, {(mesh.level == 1).sum():,} nodes"
    )
    assert code.points_at_rest() is p
    assert (code.steps, code.dt, code.law) == (0, code.solver.dt, code.solver.law)
    assert code.friction() == 0.0
    code.close()


def test_output_grows_by_a_step_and_is_closed(tmp_path) -> None:
    code = make(tmp_path)
    code.write(0.0)
    step(code)
    code.write(code.solver.time)
    code.close()
    with h5py.File(tmp_path / "fields" / "points.vtkhdf") as file:
        steps = file["VTKHDF/Steps"]
        assert steps.attrs["NSteps"] == 2
        assert steps["Values"][:].tolist() == [0.0, code.dt]
