"""What a continuum code must offer to take the place of GIMP, and the GIMP that does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gimpmd_gimp.fracture.j_integral import crack_tip
from gimpmd_gimp.laws.law import history_fields
from gimpmd_gimp.output.fields import PointsFile
from gimpmd_gimp.points.material_points import SHEAR, MaterialPoints, join, take
from gimpmd_gimp.setup import make_exchange, make_solver
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.mechanics.units import UNITS

NO_K = (np.nan, np.nan)
"""Stress intensities of laws that have none."""


class ContinuumBackend(Protocol):
    """A continuum solver as the service drives it, on one rank.

    Attributes
    ----------
    name : what the coupler's log calls it.
    offers, needs : ids of the nodes whose fields it sends and wants, shape ``(n,)``.
    """

    name: str
    offers: Ints
    needs: Ints

    def summary(self) -> str:
        """What this rank works on, for the log."""

    def zone_fields(self) -> Mapping[str, Floats]:
        """Fields of the scheme on ``offers``, of the step that ended now."""

    def finish(self) -> None:
        """Bring the step to its end, or the set-up: all that the atoms do not wait for."""

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the atoms' fields on ``needs``, of the window that ended now."""

    def advance(self) -> None:
        """Continuum step as far as ``zone_fields`` need it: the atoms wait for these."""

    def energies(self) -> Mapping[str, float]:
        """Energies, work, mass and momentum as ``messages.Account`` names them.

        Of the step that ``finish`` ended; asked for after ``advance``, at the stop after
        ``receive``.
        """

    def write(self, time: float) -> None:
        """Append the present state to the output files."""

    def close(self) -> None:
        """Close what is open."""


class GimpBackend:
    """GIMP, coupled by one of the schemes or alone.

    Parameters
    ----------
    case : Case
        With its material resolved.
    run_dir : Path
        Fields are written to ``run_dir / "fields"``, by the first rank.
    comm : mpi4py communicator, optional
        Of as many ranks as the case asks for.
    """

    name = "gimp"

    def __init__(self, case: Case, run_dir: Path, comm: Any = None) -> None:
        self._case, self._comm, self._units = case, comm, UNITS[case.units]
        self._zones = case.zones()
        self.solver = make_solver(case, comm)
        self._exchange = make_exchange(case, self.solver)
        self.offers, self.needs = self._exchange.offers, self._exchange.needs

        attributes = {"length": self._units.length, "time": self._units.time}
        attributes["stress"] = self._units.pressure
        names = ["points", "nodes"] if case.output.nodes else ["points"]
        self._files: dict[str, PointsFile] = {}
        self._tips = run_dir / "fields" / "tips.csv"
        if comm is None or comm.rank == 0:
            folder = run_dir / "fields"
            folder.mkdir(exist_ok=True)
            self._files = {
                name: PointsFile(folder / f"{name}.vtkhdf", attributes) for name in names
            }

    def summary(self) -> str:
        """Material points and nodes of every level on this rank."""
        p, mesh = self.solver.points, self.solver.mesh
        levels = [
            f"level {level}: {np.count_nonzero(p.level == level):,} material points, "
            f"{np.count_nonzero(mesh.level == level):,} nodes"
            for level in range(self.solver.top + 1)
        ]
        return f"rank {mesh.rank} of {mesh.ranks}; {'; '.join(levels)}"

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity for the atoms that follow the grid; nothing when alone."""
        return self._exchange.zone_fields()

    def finish(self) -> None:
        """What the scheme leaves for later."""
        self._exchange.finish()

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Hand the atoms' fields over to the scheme, which may get none."""
        if fields:
            self._exchange.receive(fields)

    def advance(self) -> None:
        """One step of GIMP."""
        self._exchange.advance()

    def energies(self) -> dict[str, float]:
        """Sums over the points on the continuum's side.

        Nothing between the times at which all levels stand.
        """
        books = self._exchange.books()
        if books is None:
            return {}
        energy, contact = self._units.energy_from_mechanical, self.solver.contact
        heat = self._exchange.dissipated() + (contact.friction_work if contact else 0.0)
        heat += books.dissipated
        return {
            "kinetic": energy(books.kinetic),
            "potential": energy(books.strain),
            "external_work": energy(books.external_work),
            "interface_work": energy(books.interface_work),
            "dissipated": energy(heat),
            "mass": books.mass,
            **{f"momentum_{axis}": p for axis, p in zip("xyz", books.momentum, strict=False)},
        }

    def write(self, time: float) -> None:
        """Append positions and fields of all ranks' points (and nodes, if asked); collective.

        And the energy release at the tips of cracks that ask for it.
        """
        self._write_tips(time)
        points = self._gather(self.solver.points)
        nodes = self._gather(self._nodes()) if self._case.output.nodes else []
        if self._files:
            p = join(points)
            self._files["points"].append(time, *self._point_fields(take(p, np.argsort(p.id))))
        if "nodes" in self._files:
            fields = {name: np.concatenate([part[name] for part in nodes]) for name in nodes[0]}
            self._files["nodes"].append(time, fields.pop("position"), fields)

    def close(self) -> None:
        """Close the output files."""
        for file in self._files.values():
            file.close()

    def _write_tips(self, time: float) -> None:
        """Add a line of ``tips.csv`` for every crack with a J-integral."""
        for number, crack in enumerate(self._case.continuum.cracks):
            if crack.j_radius is None or self._case.only is None:
                continue
            along = np.subtract(crack.end, crack.start)
            tip, normal, front = np.array(crack.end), None, 1.0
            if crack.along is not None:
                front = float(np.linalg.norm(crack.along))
                normal = np.cross(crack.along, along)
            found = crack_tip(self.solver, tip, along, crack.j_radius, normal, front)
            if self._files:
                per = self._units.stress_from_mechanical(1.0)
                values = [time, number, per * found.J1, *(per * k for k in found.K or NO_K)]
                if not self._tips.exists():
                    self._tips.write_text("time,crack,J,K_I,K_II\n")
                with self._tips.open("a") as file:
                    file.write(",".join(f"{v:.9g}" for v in values) + "\n")

    def _gather(self, part: Any) -> list[Any]:
        """What all ranks hold, on the first one; nothing on the others."""
        if self._comm is None:
            return [part]
        return self._comm.gather(part) or []

    def _nodes(self) -> dict[str, np.ndarray]:
        """The nodes of the basis that this rank counts, and their fields."""
        mesh, solver = self.solver.mesh, self.solver
        chosen = np.flatnonzero(mesh.counts)
        return {
            "position": _three(mesh.positions()[chosen]),
            "velocity": _three(solver.V[chosen]),
            "mass": solver.M[chosen],
            "level": mesh.level[chosen].astype(np.int32),
        }

    def _point_fields(self, p: MaterialPoints) -> tuple[Floats, dict[str, np.ndarray]]:
        """Positions ``(n, 3)`` and fields, in the units of the case."""
        solver, coupled = self.solver, self._case.only is None
        stress = np.empty_like(p.F)
        solver.law.stress(np.arange(p.count), 0, p.count, p.F, p.history, stress)
        if solver.law.finite:
            stress /= np.linalg.det(p.F)[:, None, None]  # Cauchy's from Kirchhoff's
        size = 2.0 * p.half * (solver.hierarchy.cell / 2.0**p.level)[:, None]
        if solver.scheme.interpolation == "cpgimp":
            size *= np.einsum("nkk->nk", p.F)
        inner = coupled & (self._zones.depth(p.reference) >= self._zones.handover)
        fields: dict[str, np.ndarray] = {
            "reference": _three(p.reference),
            "displacement": _three(p.x - p.reference),
            "velocity": _three(p.v),
            "strain": p.strain,
            "stress": self._units.stress_from_mechanical(1.0) * _voigt(stress),
            "zone": inner.astype(np.int32),
            "level": p.level,
            "size": size,
            **history_fields(solver.law, p.history),
        }
        return _three(p.x), fields


def _voigt(tensor: Floats) -> Floats:
    """Components of symmetric tensors ``(n, d, d)`` in Voigt order."""
    dim = tensor.shape[1]
    pairs = [*((k, k) for k in range(dim)), *SHEAR[dim]]
    return np.stack([tensor[:, i, j] for i, j in pairs], axis=1)


def _three(field: Floats) -> Floats:
    """Pad components to the three that VTK wants."""
    return np.concatenate([field, np.zeros((field.shape[0], 3 - field.shape[1]))], axis=1)
