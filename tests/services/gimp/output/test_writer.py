"""What a run writes, read back and compared with the state of its solver."""

from __future__ import annotations

from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from gimpmd_gimp.output.writer import Writer
from gimpmd_gimp.setup import make_solver
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests.cases import BAR, CONTINUUM_ONLY, changed
from tests.services.gimp.dense import disturb

BOX = {"domain": {"box": [[0, 16], [0, 8]]}, "output": {"interval": 0.1}}
MODULI = {"from": "moduli", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0}
SOLID = {"domain": {"box": [[0, 4], [0, 4], [0, 4]]}}


def start(folder: Path, changes: dict) -> tuple[Plan, Solver, Writer]:
    case = changed(BAR, CONTINUUM_ONLY | {"continuum.threads": 1} | BOX | changes)
    plan = make_plan(msgspec.convert(case, Case))
    solver = make_solver(plan)
    return plan, solver, Writer(plan, folder, solver)


def read(path: Path, step: int) -> tuple[float, dict[str, np.ndarray]]:
    """Time and fields of an output, in a file that the test reads by the format's offsets."""
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        steps = root["Steps"]
        count = root["NumberOfPoints"][steps["PartOffsets"][step]]
        fields = {}
        for name, data in root["PointData"].items():
            first = steps["PointDataOffsets"][name][step]
            fields[name] = data[first : first + count]
        first = steps["PointOffsets"][step]
        fields["position"] = root["Points"][first : first + count]
        return float(steps["Values"][step]), fields


def same(found: np.ndarray, vectors: np.ndarray) -> None:
    """Vectors have three components in the file; those beyond the domain's are zero."""
    dim = vectors.shape[1]
    np.testing.assert_array_equal(found[:, :dim], vectors)
    np.testing.assert_array_equal(found[:, dim:], 0.0)


@pytest.mark.parametrize("changes", [{}, SOLID], ids=["2-D", "3-D"])
def test_points_are_those_of_the_solver_by_their_ids(tmp_path, changes) -> None:
    _, solver, writer = start(tmp_path, changes)
    disturb(solver.points)
    writer.write(0.0)
    before = solver.points.v[np.argsort(solver.points.id)].copy()
    for _ in range(3):
        solver.step()
    writer.write(solver.time)
    writer.close()
    path = tmp_path / "fields" / "points.vtkhdf"
    time, first = read(path, 0)
    assert time == 0.0
    same(first["velocity"], before)
    time, found = read(path, 1)
    assert time == solver.time
    p = solver.points
    order = np.argsort(p.id)
    same(found["position"], p.x[order])
    same(found["reference"], p.reference[order])
    same(found["displacement"], (p.x - p.reference)[order])
    same(found["velocity"], p.v[order])
    np.testing.assert_array_equal(found["level"], p.level[order])
    np.testing.assert_array_equal(found["size"], 0.5)
    np.testing.assert_array_equal(found["zone"], 0)
    # Hooke's law with lambda = mu = 1/3, strains with engineering shear in Voigt's order
    eps, dim = found["strain"], p.dim
    pairs = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)]}[dim]
    H = p.F[order] - np.eye(dim)
    for k in range(dim):
        np.testing.assert_allclose(eps[:, k], H[:, k, k], atol=1e-15)
    for column, (i, j) in enumerate(pairs, start=dim):
        np.testing.assert_allclose(eps[:, column], H[:, i, j] + H[:, j, i], atol=1e-15)
    trace = eps[:, :dim].sum(axis=1, keepdims=True)
    stress = np.hstack([(trace + 2.0 * eps[:, :dim]) / 3.0, eps[:, dim:] / 3.0])
    np.testing.assert_allclose(found["stress"], stress, atol=1e-15)


def test_finite_laws_write_cauchy_stress(tmp_path) -> None:
    """Of uniform dilation F = s I: ``sigma = (lame ln J + mu (s^2 - 1)) / J``."""
    material = MODULI | {"model": "neo-hookean"}
    _, solver, writer = start(tmp_path, {"continuum.material": material})
    s = 1.1
    solver.points.F[:] = s * np.eye(2)
    writer.write(0.0)
    writer.close()
    _, found = read(tmp_path / "fields" / "points.vtkhdf", 0)
    J = s**2
    pressure = (np.log(J) + s**2 - 1.0) / 3.0 / J
    np.testing.assert_allclose(found["stress"][:, :2], pressure, rtol=1e-12)
    np.testing.assert_allclose(found["stress"][:, 2], 0.0, atol=1e-15)


def test_stretched_domains_have_their_present_size(tmp_path) -> None:
    _, solver, writer = start(tmp_path, {"continuum.interpolation": "cpgimp"})
    solver.points.F[:, 0, 0] = 1.25
    writer.write(0.0)
    writer.close()
    _, found = read(tmp_path / "fields" / "points.vtkhdf", 0)
    np.testing.assert_allclose(found["size"], np.tile([0.625, 0.5], (512, 1)), rtol=1e-14)


def test_stresses_are_in_the_pressure_unit_of_the_case(tmp_path) -> None:
    density, bulk = 0.1, 1e4
    moduli = {"from": "moduli", "density": density, "lame": bulk, "shear": bulk}
    plan, solver, writer = start(
        tmp_path,
        {"units": "metal", "continuum.material": moduli, "time": {"end": 1e-3, "step": 1e-4}},
    )
    solver.points.F[:, 0, 0] = 1.001
    writer.write(0.0)
    writer.close()
    path = tmp_path / "fields" / "points.vtkhdf"
    _, found = read(path, 0)
    np.testing.assert_allclose(found["stress"][:, 0], 3.0 * bulk * 1e-3, rtol=1e-9)
    units = UNITS[plan.units]
    with h5py.File(path) as file:
        names = [file.attrs[name] for name in ("length", "time", "stress")]
    assert names == [units.length, units.time, units.pressure]


def test_nodes_are_written_where_a_case_asks_for_them(tmp_path) -> None:
    levels = [{"boxes": [[[4, 12], [0, 8]]]}]
    quiet, _, writer = start(tmp_path, {})
    writer.close()
    assert not quiet.write_nodes
    assert not (tmp_path / "fields" / "nodes.vtkhdf").exists()
    changes = {"output": {"interval": 0.1, "nodes": True}, "grid.levels": levels}
    plan, solver, writer = start(tmp_path, changes)
    assert plan.write_nodes
    solver.step()
    writer.write(solver.time)
    writer.close()
    _, found = read(tmp_path / "fields" / "nodes.vtkhdf", 0)
    assert found["mass"].sum() == pytest.approx(16.0 * 8.0, rel=1e-12)
    mesh = solver.mesh
    for level in (0, 1):
        here = found["level"] == level
        assert here.sum() == (mesh.basis & (mesh.level == level)).sum()
        rows = np.rint(found["position"][here, :2] * 2**level).astype(np.int64)
        nodes = mesh.find(level, rows)
        same(found["velocity"][here], solver.V[nodes])


def test_crack_tips_have_a_line_for_each_output(tmp_path) -> None:
    """Without a load there is no energy to release."""
    cracks = [
        {"from": [0, 4], "to": [5, 4], "j_radius": 2},
        {"from": [16, 4], "to": [12, 4]},
        {"from": [16, 2], "to": [11, 2], "j_radius": 1.5},
    ]
    _, solver, writer = start(tmp_path, {"continuum.cracks": cracks})
    writer.write(0.0)
    solver.step()
    writer.write(solver.time)
    writer.close()
    head, *lines = (tmp_path / "fields" / "tips.csv").read_text().splitlines()
    assert head == "time,crack,J,K_I,K_II"
    values = np.array([line.split(",") for line in lines], dtype=float)
    assert values[:, 1].tolist() == [0, 2, 0, 2]
    np.testing.assert_allclose(values[:, 0], np.repeat([0.0, solver.time], 2), rtol=1e-8)
    np.testing.assert_array_equal(values[:, 2:], 0.0)
