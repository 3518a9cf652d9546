"""State of a run in a file, from which the run goes on with the same bits.

Points are sorted when the state is saved, so a run that saves goes on with the bits that the
restored run has; the sums of a run that never saved may differ in the last bits. What the case
says (mesh, law, scheme, conditions) is not saved: restore into a solver built from the same case,
on the same number of ranks. Each rank has a file of its own.
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
"""Raised when files of before can no longer be read."""


def rank_file(path: Path, rank: int, ranks: int) -> Path:
    """File of one rank: ``state.h5`` is that of a single rank, ``state.0.h5`` the first of many."""
    return path if ranks == 1 else path.with_suffix(f".{rank}{path.suffix}")


def save(solver: Solver, path: Path) -> None:
    """Write the state at a time at which all levels stand; collective.

    A file appears under its name once it is complete, in place of an older one.

    Raises
    ------
    ValueError
        Levels stand at different times.
    """
    if not solver.synchronous():
        raise ValueError(f"levels do not stand at the same time after {solver.steps} steps")
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
    """Bring a solver, built from the same case, to a saved state; collective.

    Raises
    ------
    BackendError
        The file is missing, damaged, of another version, or of another run.
    """
    own = rank_file(path, solver.mesh.rank, solver.mesh.ranks)
    try:
        with h5py.File(own, "r") as file:
            attributes = dict(file.attrs)
            arrays = {name: file[name][()] for name in _arrays(solver) if name in file}
    except OSError as error:
        raise BackendError(f"GIMP: no state can be read from {own}: {error}") from error
    for name, mine in _identity(solver).items():
        theirs = attributes.get(name)
        if theirs != mine:
            raise BackendError(
                f"GIMP: the state in {own} has {name} = {theirs}, this run {mine}; "
                "restart with the case and the number of ranks that wrote it"
            )
    if _digest(arrays) != attributes.get("digest"):
        raise BackendError(f"GIMP: the state in {own} is damaged; restart from an older one")
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
    """All that changes in a run."""
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
    """What must be the same in the run that goes on."""
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
