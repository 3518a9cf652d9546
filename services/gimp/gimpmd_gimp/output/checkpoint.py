"""Checkpoints: the state of a run in a file, from which the run continues with the same bits.

Saving sorts the points. The run that saves therefore continues with the same bits as the restored
run, but the sums of a run that never saves may differ in the last bits. The checkpoint holds the
points, with their history variables, and the clocks and works of the solver. It does not hold the
mesh, law, method and conditions: restore into a solver that was built from the same case, on the
same number of ranks. Each rank writes its own file.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gimpmd_gimp.boundary.condition import Condition
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.errors import BackendError

VERSION = 3
"""Version of the file format; files of other versions cannot be read."""


def rank_file(path: Path, rank: int, ranks: int) -> Path:
    """File of one rank: ``state.h5`` for a single rank, ``state.0.h5`` for the first of several."""
    return path if ranks == 1 else path.with_suffix(f".{rank}{path.suffix}")


def save(solver: Solver, path: Path) -> None:
    """Write the state at a time that all levels have reached; collective.

    A file gets its name when it is complete, and replaces an older one.

    Raises
    ------
    ValueError
        The levels have not all reached the present time.
    """
    if not solver.clock.synchronous():
        raise ValueError(
            f"levels stand at different times after {solver.steps} steps; a checkpoint is possible "
            f"every {2**solver.top} steps"
        )
    solver.refresh()
    solver.regroup()
    own = rank_file(path, solver.mesh.rank, solver.mesh.ranks)
    partial = own.with_suffix(own.suffix + ".part")
    arrays = _arrays(solver)
    with h5py.File(partial, "w") as file:
        for name, array in arrays.items():
            file[name] = array
        file.attrs.update(_identity(solver))
        file.attrs["digest"] = _digest(arrays)
    os.replace(partial, own)


def load(solver: Solver, path: Path) -> None:
    """Set a solver that was built from the same case to a saved state; collective.

    Raises
    ------
    BackendError
        The file is missing or damaged, or belongs to another version or another run.
    """
    own = rank_file(path, solver.mesh.rank, solver.mesh.ranks)
    try:
        with h5py.File(own, "r") as file:
            attributes = dict(file.attrs)
            arrays = {name: file[name][()] for name in _arrays(solver) if name in file}
    except OSError as error:
        raise BackendError(
            f"GIMP: cannot read the checkpoint {own}: {error}; restart from an older one"
        ) from error
    for name, mine in _identity(solver).items():
        theirs = attributes.get(name)
        if theirs != mine:
            raise BackendError(
                f"GIMP: the checkpoint {own} has {name} = {theirs}, but this run has {mine}; "
                "restart with the case and the number of ranks that wrote it"
            )
    if _digest(arrays) != attributes.get("digest"):
        raise BackendError(f"GIMP: the checkpoint {own} is damaged; restart from an older one")
    points = {field.name: arrays[f"points/{field.name}"] for field in fields(MaterialPoints)}
    clock, work = solver.clock, solver.work
    clock.time, clock.steps = float(arrays["time"]), int(arrays["steps"])
    clock.velocity_time[:], clock.span[:] = arrays["velocity_time"], arrays["span"]
    work.external, work.interface = map(float, arrays["works"])
    for number, condition in enumerate(solver.conditions):
        condition.restore({key: arrays[name] for key, name in _names(number, condition).items()})
    solver.arrange(MaterialPoints(**points))


def _arrays(solver: Solver) -> dict[str, Any]:
    """All that changes during a run."""
    points, clock, work = solver.points, solver.clock, solver.work
    arrays = {f"points/{field.name}": getattr(points, field.name) for field in fields(points)}
    arrays |= {
        "time": np.float64(clock.time),
        "steps": np.int64(clock.steps),
        "velocity_time": clock.velocity_time,
        "span": clock.span,
        "works": np.array([work.external, work.interface]),
    }
    for number, condition in enumerate(solver.conditions):
        state = condition.state()
        arrays |= {name: state[key] for key, name in _names(number, condition).items()}
    return arrays


def _names(number: int, condition: Condition) -> dict[str, str]:
    """Name in the file of each part of the state of a condition."""
    return {key: f"conditions/{number}/{key}" for key in condition.state()}


def _identity(solver: Solver) -> dict[str, Any]:
    """What must be the same in the run that continues."""
    h, mesh = solver.hierarchy, solver.mesh
    return {
        "version": VERSION,
        "rank": mesh.rank,
        "ranks": mesh.ranks,
        "hierarchy": repr(h),
        "nodes": mesh.size,
        "law": repr(solver.law),
        "method": repr(solver.method),
        "dt": solver.dt,
    }


def _digest(arrays: dict[str, Any]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
