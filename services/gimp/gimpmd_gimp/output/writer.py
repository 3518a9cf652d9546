"""Output of a GIMP run: points, nodes, and energy release at crack tips, in units of the case."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gimpmd_gimp.fracture.j_integral import crack_tip
from gimpmd_gimp.laws.law import Law, history_fields
from gimpmd_gimp.output.fields import PointsFile
from gimpmd_gimp.points.material_points import SHEAR, MaterialPoints, join, take
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.files import cut_file
from gimpmd_schemas.checkpoint.states import Array, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

NO_K = (np.nan, np.nan)
"""Stress intensities of laws that have none."""

log = logging.getLogger(__name__)


class Writer:
    """Writes the state of a solver to files of the first rank.

    Parameters
    ----------
    plan : Plan
    run_dir : Path
        Files are in ``run_dir / "fields"``.
    solver : Solver
    """

    def __init__(self, plan: Plan, run_dir: Path, solver: Solver) -> None:
        self._plan, self._solver, self._units = plan, solver, UNITS[plan.units]
        self._comm, self._is_first = solver.mesh.comm, solver.mesh.rank == 0
        self._tips = run_dir / "fields" / "tips.csv"
        self._folder = run_dir / "fields"
        self._names = ["points", "nodes"] if plan.write_nodes else ["points"]
        self._files: dict[str, PointsFile] = {}  # of the first rank, from the first output on

    def _open(self, lengths: Mapping[str, Mapping[str, int]] | None = None) -> None:
        """Open the files of the first rank: new ones, or earlier ones with their lengths."""
        units = self._units
        attributes = {"length": units.length, "time": units.time, "stress": units.pressure}
        self._folder.mkdir(exist_ok=True)
        for name in self._names:
            path = self._folder / f"{name}.vtkhdf"
            try:
                earlier = None if lengths is None else lengths[name]
                self._files[name] = PointsFile(path, attributes, earlier)
            except BackendError as error:  # a process may have been killed while it wrote
                aside = path.with_name(f"{name}.damaged.vtkhdf")
                if path.exists():
                    path.replace(aside)
                log.warning("%s; it is now %s, and a new file begins here", error, aside)
                self._files[name] = PointsFile(path, attributes)

    def state(self) -> dict[str, Array]:
        """Lengths of the files, on the first rank; see `checkpoint.states`."""
        lengths = {name: file.lengths() for name, file in self._files.items()}
        tips = self._tips.stat().st_size if self._is_first and self._tips.exists() else 0
        return {
            "output/lengths": np.frombuffer(msgspec.json.encode(lengths), np.uint8),
            "output/tips": np.asarray(tips),
        }

    def restore(self, saved: SavedStates) -> None:
        """Go on with the files as they were at a checkpoint.

        Fields that are damaged are set aside, and the log says so.

        Raises
        ------
        BackendError
            ``tips.csv`` is gone or shorter.
        """
        if not self._is_first:
            return
        first = next(saved.parts())
        text = first["output/lengths"].tobytes()
        lengths = msgspec.json.decode(text, type=dict[str, dict[str, int]])
        if lengths:
            self._open(lengths)
        cut_file(self._tips, int(first["output/tips"]))

    def write(self, time: float) -> None:
        """Append the present state: points, crack tips and, if asked for, nodes; collective."""
        if self._is_first and not self._files:
            self._open()
        self._write_tips(time)
        points = self._gather(self._solver.points)
        nodes = self._gather(self._nodes()) if self._plan.write_nodes else []
        if self._files:
            p = join(points)
            p = take(p, np.argsort(p.id))
            size = 2.0 * p.half * (self._solver.hierarchy.cell / 2.0**p.level)[:, None]
            if self._solver.body.stretched:
                size *= np.einsum("nkk->nk", p.F)
            fields = point_fields(p, size, self._solver.law, self._plan)
            self._files["points"].append(time, three(p.x), fields)
        if "nodes" in self._files:
            fields = {name: np.concatenate([part[name] for part in nodes]) for name in nodes[0]}
            self._files["nodes"].append(time, fields.pop("position"), fields)

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()

    def _write_tips(self, time: float) -> None:
        """Add a line to ``tips.csv`` for every crack with a J-integral."""
        if self._plan.coupling is not None:
            return
        solver = self._solver
        for number, crack in enumerate(self._plan.continuum.cracks):
            if crack.j_radius is None:
                continue
            along = np.subtract(crack.end, crack.start)
            tip, normal, front = np.array(crack.end), None, 1.0
            if crack.along is not None:
                front = float(np.linalg.norm(crack.along))
                normal = np.cross(crack.along, along)
            state = (solver.body, solver.V, solver.clock.span)
            found = crack_tip(*state, tip, along, crack.j_radius, normal, front)
            if self._is_first:
                per = self._units.stress_from_mechanical(1.0)
                values = [time, number, per * found.J1, *(per * k for k in found.K or NO_K)]
                if not self._tips.exists():
                    self._tips.write_text("time,crack,J,K_I,K_II\n")
                with self._tips.open("a") as file:
                    file.write(",".join(f"{v:.9g}" for v in values) + "\n")

    def _gather(self, part: Any) -> list[Any]:
        """Parts of all ranks, on the first rank; nothing on the others."""
        if self._comm is None:
            return [part]
        return self._comm.gather(part) or []

    def _nodes(self) -> dict[str, np.ndarray]:
        """The nodes of the basis that this rank counts, and their fields."""
        mesh, solver = self._solver.mesh, self._solver
        chosen = np.flatnonzero(mesh.counts)
        return {
            "position": three(mesh.positions()[chosen]),
            "velocity": three(solver.V[chosen]),
            "mass": solver.M[chosen],
            "level": mesh.level[chosen].astype(np.int32),
        }


def point_fields(p: MaterialPoints, size: Floats, law: Law, plan: Plan) -> dict[str, np.ndarray]:
    """Fields of points, in the units of the case.

    Parameters
    ----------
    p : MaterialPoints
    size : ndarray, shape ``(n, d)``
        Edges of the points.
    law : Law
    plan : Plan
    """
    coupling, stress = plan.coupling, np.empty_like(p.F)
    everyone, energy = np.arange(p.count), np.empty(p.count)
    law.stress(everyone, 0, p.count, p.F, p.history, stress)
    law.energy(everyone, 0, p.count, p.F, p.history, energy)
    if law.finite:
        stress /= np.linalg.det(p.F)[:, None, None]  # from Kirchhoff to Cauchy stress
    inner = np.zeros(p.count, dtype=np.int32)
    if coupling is not None:
        inner[coupling.zones.depth(p.reference) >= coupling.zones.handover] = 1
    pressure = UNITS[plan.units].stress_from_mechanical(1.0)
    return {
        "reference": three(p.reference),
        "displacement": three(p.x - p.reference),
        "velocity": three(p.v),
        "strain": p.strain,
        "displacement_gradient": (p.F - np.eye(p.dim)).reshape(p.count, -1),
        "stress": pressure * _voigt(stress),
        "strain_energy": pressure * energy,
        "mass": p.mass,
        "zone": inner,
        "level": p.level,
        "size": size,
        **history_fields(law, p.history),
    }


def _voigt(tensor: Floats) -> Floats:
    """Components of symmetric tensors ``(n, d, d)`` in Voigt order."""
    dim = tensor.shape[1]
    pairs = [*((k, k) for k in range(dim)), *SHEAR[dim]]
    return np.stack([tensor[:, i, j] for i, j in pairs], axis=1)


def three(field: Floats) -> Floats:
    """Pad vectors with zeros to the three components that VTK expects."""
    return np.concatenate([field, np.zeros((field.shape[0], 3 - field.shape[1]))], axis=1)
