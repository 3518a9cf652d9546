"""Checkpoints: the state of a run in a file, from which the run continues with the same bits.

Saving sorts the points. The run that saves therefore continues with the same bits as the restored
run, but the sums of a run that never saves may differ in the last bits. The checkpoint holds the
points, with their history variables, and the clocks and works of the solver. It does not hold the
mesh, law, scheme and conditions: restore into a solver that was built from the same case, on the
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

from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.errors import BackendError

VERSION = 2
"""Version of the format; increased when older files can no longer be read."""


def rank_file(path: Path, rank: int, ranks: int) -> Path:
    """File of one rank: ``state.h5`` for a single rank, else ``state.0.h5``, ``state.1.h5``, ..."""
    return path if ranks == 1 else path.with_suffix(f".{rank}{path.suffix}")


def save(solver: Solver, path: Path) -> None:
    """Write the state, at a time that all levels have reached; collective.

    The file gets its name when it is complete, and then replaces an older one.

    Raises
    ------
    ValueError
        The levels are at different times.
    """
    if not solver.synchronous():
        raise ValueError(
            f"the levels are not at the same time after {solver.steps} steps: save between two "
            "steps of the coarsest level"
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
    """Bring a solver that was built from the same case to a saved state; collective.

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
    solver.time, solver.steps = float(arrays["time"]), int(arrays["steps"])
    solver.clock[:], solver.span[:] = arrays["clock"], arrays["span"]
    solver.external_work, solver.interface_work = map(float, arrays["works"])
    if solver.contact is not None:
        solver.contact.state[:] = arrays["contact/state"]
        solver.contact.friction_work = float(arrays["contact/work"])
    solver.arrange(MaterialPoints(**points))
    solver.project_anew()


def _arrays(solver: Solver) -> dict[str, Any]:
    """Everything that changes during a run."""
    points = solver.points
    arrays = {f"points/{field.name}": getattr(points, field.name) for field in fields(points)}
    arrays |= {
        "time": np.float64(solver.time),
        "steps": np.int64(solver.steps),
        "clock": solver.clock,
        "span": solver.span,
        "works": np.array([solver.external_work, solver.interface_work]),
    }
    if solver.contact is not None:
        arrays["contact/state"] = solver.contact.state
        arrays["contact/work"] = np.float64(solver.contact.friction_work)
    return arrays


def _identity(solver: Solver) -> dict[str, Any]:
    """Values that must be the same in the run that continues."""
    h, mesh = solver.hierarchy, solver.mesh
    return {
        "version": VERSION,
        "rank": mesh.rank,
        "ranks": mesh.ranks,
        "hierarchy": repr(h),
        "nodes": mesh.size,
        "law": repr(solver.law),
        "scheme": repr(solver.scheme),
        "dt": solver.dt,
    }


def _digest(arrays: dict[str, Any]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
