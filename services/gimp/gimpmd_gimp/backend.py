"""What a continuum code must offer to take the place of GIMP, and the GIMP that does."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from gimpmd_gimp.cracks import make_cracks
from gimpmd_gimp.faces import make_driven, make_tractions
from gimpmd_gimp.fields import NodesFile, PointsFile
from gimpmd_gimp.materials import LinearElastic
from gimpmd_gimp.points import MaterialPoints, fill_domain, keep
from gimpmd_gimp.solver import Scheme, Solver
from gimpmd_gimp.velocity_exchange import VelocityExchange
from gimpmd_schemas.case import Case
from gimpmd_schemas.grid import Floats, Ints
from gimpmd_schemas.initial import initial_state
from gimpmd_schemas.units import UNITS


class ContinuumBackend(Protocol):
    """A continuum solver as the service drives it.

    Attributes
    ----------
    name : what the coupler's log calls it.
    offers, needs : ids of the nodes whose fields it sends and wants, shape ``(n,)``.
    """

    name: str
    offers: Ints
    needs: Ints

    def zone_fields(self) -> Mapping[str, Floats]:
        """Fields of the scheme on ``offers``, of the step that ended now."""

    def energies(self) -> Mapping[str, float]:
        """Energies, work, mass and momentum as ``messages.Exchange`` names them."""

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the atoms' fields on ``needs``, of the window that ended now."""

    def advance(self) -> None:
        """Continuum step as far as ``zone_fields`` need it: the atoms wait for these."""

    def finish(self) -> None:
        """Bring the step that ``advance`` began to its end."""

    def write(self, time: float) -> None:
        """Append the present state to the output files."""

    def close(self) -> None:
        """Close what is open."""


class GimpBackend:
    """GIMP on one level, coupled by the velocity exchange or alone.

    Parameters
    ----------
    case : Case
        With its material resolved.
    run_dir : Path
        Fields are written to ``run_dir / "fields"``.
    """

    name = "gimp"

    def __init__(self, case: Case, run_dir: Path) -> None:
        self._case, self._zones, self._units = case, case.zones(), UNITS[case.units]
        self.solver = make_solver(case)
        coupled = case.only is None
        self._exchange = (
            VelocityExchange(self.solver, self._zones, case.filter_rate()) if coupled else None
        )
        nothing = np.empty(0, dtype=np.int64)
        self.offers = self._exchange.offers if self._exchange else nothing
        self.needs = self._exchange.needs if self._exchange else nothing
        depth = self._zones.depth(self.solver.points.reference)
        own = depth < self._zones.energy_plane if coupled else np.ones(depth.size, np.bool_)
        self.solver.add_group("own", np.flatnonzero(own).astype(np.int64))
        self._zone = (depth >= self._zones.handover).astype(np.int32) * coupled

        attributes = {"length": self._units.length, "time": self._units.time}
        attributes["stress"] = self._units.pressure
        folder = run_dir / "fields"
        folder.mkdir(exist_ok=True)
        count = self.solver.points.count
        self._points_file = PointsFile(folder / "points.vtkhdf", count, attributes)
        self._nodes_file = (
            NodesFile(folder / "nodes.vtkhdf", self.solver.grid, attributes)
            if case.output.nodes
            else None
        )

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity for the boundary atoms; nothing when alone."""
        return self._exchange.zone_fields() if self._exchange else {}

    def energies(self) -> dict[str, float]:
        """Sums over the points on the continuum's side of the energy plane."""
        energy = self._units.energy_from_mechanical
        kinetic, strain, mass, momentum_x, momentum_y = self.solver.energies("own").tolist()
        return {
            "kinetic": energy(kinetic),
            "potential": energy(strain),
            "external_work": energy(self.solver.external_work),
            "interface_work": energy(self.solver.interface_work),
            "mass": mass,
            "momentum_x": momentum_x,
            "momentum_y": momentum_y,
        }

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Let the inner points follow the atoms; before the first step they stand as set up."""
        if self._exchange and self.solver.steps:
            self._exchange.follow_atoms(fields)

    def advance(self) -> None:
        """One step of GIMP."""
        self.solver.step()

    def finish(self) -> None:
        """Apply the zone filter when coupled."""
        if self._exchange:
            self._exchange.filter_transition()

    def write(self, time: float) -> None:
        """Append positions and fields of the points (and nodes, if asked) to ``fields/``."""
        p, h = self.solver.points, self.solver.grid.cell
        stress = np.empty_like(p.strain)
        self.solver.material.stress(p.strain, stress)
        fields: dict[str, np.ndarray] = {
            "reference": _three(p.reference),
            "displacement": _three(p.x - p.reference),
            "velocity": _three(p.v),
            "strain": p.strain,
            "stress": self._units.stress_from_mechanical(1.0) * stress,
            "zone": self._zone,
            "size": 2.0 * h * p.half,
        }
        self._points_file.append(time, _three(p.x), fields)
        if self._nodes_file:
            nodal = {"velocity": _three(self.solver.V), "mass": self.solver.M}
            self._nodes_file.append(time, nodal)

    def close(self) -> None:
        """Close the output files."""
        self._points_file.close()
        if self._nodes_file:
            self._nodes_file.close()


def make_solver(case: Case) -> Solver:
    """Points, conditions and solver of a case, in its initial state."""
    grid, zones, units = case.background_grid(), case.zones(), UNITS[case.units]
    elastic = case.elastic()
    points = fill_domain(grid, case.grid.points_per_cell, elastic.density)
    coupled = case.only is None
    if coupled:
        points = keep(points, zones.depth(points.reference) < zones.innermost)
    _set_initial_state(case, points)
    depth = zones.depth(points.reference)
    inner = np.flatnonzero(depth >= zones.handover) if coupled else np.empty(0, dtype=np.int64)
    # in a coupled run the atoms hold the cracks, deeper than any material point
    cracks = make_cracks(() if coupled else case.continuum.cracks, grid)
    positions = grid.positions()
    positions = np.concatenate([positions, positions[cracks.twins]])
    atoms_side = coupled & (zones.depth(positions) >= zones.energy_plane)
    integrator = case.continuum.integrator
    if integrator == "auto":
        integrator = "musl" if coupled else "usavg"
    return Solver(
        grid=grid,
        points=points,
        material=LinearElastic(
            units.stress_to_mechanical(elastic.lame), units.stress_to_mechanical(elastic.shear)
        ),
        scheme=Scheme(
            integrator=integrator,
            stretch=case.continuum.interpolation == "cpgimp",
            xpic_order=case.continuum.xpic.order,
            xpic_every=case.continuum.xpic.every,
        ),
        dt=case.step(),
        tractions=make_tractions(case, grid, points),
        driven=make_driven(case, grid, positions),
        cracks=cracks,
        inner=inner.astype(np.int64),
        booked=~atoms_side,
        threads=thread_count(case.continuum.threads),
    )


def thread_count(threads: int | Literal["auto"]) -> int:
    """How many threads share the sweeps; ``auto`` takes all cores that this process may use."""
    return len(os.sched_getaffinity(0)) if threads == "auto" else threads


def _set_initial_state(case: Case, points: MaterialPoints) -> None:
    u, v, gradient = initial_state(case, points.reference)
    points.x += u
    points.v += v
    points.strain[:, 0] = gradient[:, 0, 0]
    points.strain[:, 1] = gradient[:, 1, 1]
    points.strain[:, 2] = gradient[:, 0, 1] + gradient[:, 1, 0]


def _three(field: Floats) -> Floats:
    """Pad two components to the three that VTK wants."""
    return np.concatenate([field, np.zeros((field.shape[0], 1))], axis=1)
