"""A run that is saved and restored continues with the same bits."""

from __future__ import annotations

import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.prescribed_displacement import PrescribedDisplacement
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import J2Plasticity, LinearElastic, NeoHookean
from gimpmd_gimp.laws.law import history_size
from gimpmd_gimp.output.checkpoint import renew, restore, state
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.checkpoint.manifest import folder_of, state_file
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.ranks import on_ranks

FINER = ((((10, 28), (16, 32)),),)


def make(finer, integrator, comm=None, dt=0.2, finite=False, configuration="current", beta=0.0):
    """A body with loads, a crack with friction, damping, a group of points and a large motion."""
    h = Hierarchy((0.0, 0.0), 1.0, (20, 24), (False, False), finer)
    cracks = make_cracks([((0.0, 11.7), (20.0, 12.4))], h, friction=0.2)
    mesh = Mesh(h, comm, cracks=cracks)
    law = (NeoHookean if finite else LinearElastic)(1.0, 1.0 / 3.0, 1.0 / 3.0)
    points = fill(mesh, 2, 1.0)
    points.v[:, 0] = 0.02 * np.sin(points.reference[:, 0])
    points.v[:, 1] = 0.05
    damping = (DampingRegion(((0.0, 4.0),) * 2, 0.01, 0.95),)
    interpolation = "cpgimp" if configuration == "current" else "ugimp"
    method = Method(integrator, interpolation, 5, 7, damping, configuration, beta)
    solver = Solver(
        mesh,
        points,
        law,
        method,
        dt,
        conditions=[
            Traction(1, 1, (2e-3, -5e-3), lambda time: min(time, 1.0)),
            Absorbing(0, 1),
            PrescribedDisplacement(1, 0, 1, lambda time: 0.05 * time),
        ],
        cracks=cracks,
    )
    left = solver.body.add_group(solver.points.reference[:, 0] < 5.0)
    return solver, left


def advance(solver, steps):
    for _ in range(steps):
        solver.step()


def save(solver, folder):
    folder.mkdir(parents=True, exist_ok=True)
    renew(solver)
    save_state(folder, solver.steps, "continuum", solver.mesh.rank, state(solver))


def load(solver, folder, step, ranks=None):
    ranks = ranks or solver.mesh.ranks
    paths = tuple(folder_of(folder, step) / state_file("continuum", rank) for rank in range(ranks))
    restore(solver, SavedStates(step, paths, solver.mesh.rank, solver.mesh.ranks))


def same(a, b, group):
    for field in fields(a.points):
        assert np.array_equal(getattr(a.points, field.name), getattr(b.points, field.name)), field
    for name in ("M", "V"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    for name in ("velocity_time", "span", "time", "steps"):
        assert np.array_equal(getattr(a.clock, name), getattr(b.clock, name)), name
    assert a.work.external == b.work.external
    assert a.work.interface == b.work.interface
    assert a.contact.dissipated == b.contact.dissipated
    assert np.array_equal(a.contact.states, b.contact.states)
    assert np.array_equal(a.energies(group), b.energies(group))


def goes_on(path, finer, integrator, comm=None):
    first, left = make(finer, integrator, comm)
    advance(first, 16)
    save(first, path)
    restored, _ = make(finer, integrator, comm)
    if comm is not None:
        comm.barrier()
    load(restored, path, 16)
    for solver in (first, restored):
        advance(solver, 24)
    same(first, restored, left)
    assert np.abs(first.points.x - first.points.reference).max() > 0.25  # points were sorted anew
    return first


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
@pytest.mark.parametrize("finer", [(), FINER], ids=["one level", "two levels"])
def test_the_same_bits_after_a_restart(tmp_path, finer, integrator):
    first = goes_on(tmp_path, finer, integrator)
    assert first.contact.dissipated > 0.0
    assert first.work.external != 0.0


def every_way():
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    folder = world.bcast(tempfile.mkdtemp() if world.rank == 0 else None)
    for finer, integrator in ((FINER, "usavg"), ((), "musl")):
        goes_on(Path(folder) / integrator, finer, integrator, world)


def test_the_same_bits_on_two_ranks():
    on_ranks(2, __file__, "every_way")


def test_saving_does_not_change_what_is_computed(tmp_path):
    """Except for the order of sums."""
    (saved, _), (other, _) = make(FINER, "usavg"), make(FINER, "usavg")
    advance(saved, 16)
    save(saved, tmp_path)
    advance(saved, 8)
    advance(other, 24)
    a, b = np.argsort(saved.points.id), np.argsort(other.points.id)
    assert np.array_equal(saved.points.id[a], other.points.id[b])
    assert np.abs(saved.points.v[a] - other.points.v[b]).max() < 1e-13


def test_finite_law(tmp_path):
    first, left = make((), "usavg", finite=True)
    advance(first, 5)
    save(first, tmp_path)
    restored, _ = make((), "usavg", finite=True)
    load(restored, tmp_path, first.steps)
    for solver in (first, restored):
        advance(solver, 5)
    same(first, restored, left)


@pytest.mark.parametrize("finer", [(), FINER], ids=["one level", "two levels"])
@pytest.mark.parametrize("beta", [0.0, 0.7])
def test_reference_configuration(tmp_path, finer, beta):
    fixed = {"finite": True, "configuration": "reference", "beta": beta}
    first, left = make(finer, "musl", **fixed)
    advance(first, 16)
    save(first, tmp_path)
    restored, _ = make(finer, "musl", **fixed)
    load(restored, tmp_path, first.steps)
    for solver in (first, restored):
        advance(solver, 24)
    same(first, restored, left)


@pytest.mark.parametrize("integrator", ["usavg", "musl", "usl", "usf"])
def test_history_variables(tmp_path, integrator):
    """A bar that has begun to yield before it is saved, and yields further after that."""

    def bar():
        mesh, law = (
            Mesh(Hierarchy((0.0,), 1.0, (16,), (False,))),
            J2Plasticity(1, 1, 1, 0.01, 0.2, 1),
        )
        points = fill(mesh, 2, law.density, history_size(law))
        push = PrescribedVelocity(0, 0, 0, lambda _: 0.05)
        method = Method(integrator, configuration="reference")
        return Solver(mesh, points, law, method, 0.2, conditions=[push])

    first, restored = bar(), bar()
    advance(first, 20)
    save(first, tmp_path)
    load(restored, tmp_path, first.steps)
    before = first.points.history.copy()
    assert before.any()
    for solver in (first, restored):
        advance(solver, 20)
    assert (first.points.history != before).any()
    for field in fields(first.points):
        one, other = (getattr(solver.points, field.name) for solver in (first, restored))
        assert np.array_equal(one, other), field.name


def test_a_state_between_coarse_steps_is_refused(tmp_path):
    solver, _ = make(FINER, "usavg")
    solver.step()
    with pytest.raises(ValueError, match="different times after 1 steps"):
        save(solver, tmp_path)


def body(comm=None):
    """A body in its reference configuration, without conditions that keep a state."""
    h = Hierarchy((0.0, 0.0), 1.0, (20, 24), (False, False), FINER)
    law = NeoHookean(1.0, 1.0 / 3.0, 1.0 / 3.0)
    mesh = Mesh(h, comm)
    points = fill(mesh, 2, 1.0)
    points.v[:, 0] = 0.02 * np.sin(points.reference[:, 0])
    return Solver(mesh, points, law, Method("musl", configuration="reference"), 0.2)


def on_another_number_of_ranks():
    """Saved on one rank, continued on two, and compared with the run that stayed on one."""
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    folder = Path(world.bcast(tempfile.mkdtemp() if world.rank == 0 else None))
    alone = body()
    advance(alone, 16)
    if world.rank == 0:
        save(alone, folder)
    world.barrier()
    both = body(world)
    load(both, folder, 16, ranks=1)
    for solver in (alone, both):
        advance(solver, 16)
    ids = np.concatenate(world.allgather(both.points.id))
    v = np.concatenate(world.allgather(both.points.v))[np.argsort(ids)]
    assert np.array_equal(np.sort(ids), np.sort(alone.points.id))
    assert both.points.count < alone.points.count
    assert np.abs(v - alone.points.v[np.argsort(alone.points.id)]).max() < 1e-15


def test_another_number_of_ranks():
    on_ranks(2, __file__, "on_another_number_of_ranks")


def test_the_state_of_contact_stays_with_its_ranks(tmp_path):
    solver, _ = make((), "musl")
    save(solver, tmp_path)
    folder = folder_of(tmp_path, 0)
    (folder / state_file("continuum", 1)).write_bytes(
        (folder / state_file("continuum", 0)).read_bytes()
    )
    with pytest.raises(BackendError, match="go on with 2 ranks"):
        load(solver, tmp_path, 0, ranks=2)
