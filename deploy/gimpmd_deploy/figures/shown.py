"""What a figure of a field shows: which particles of each side, with the values of the field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gimpmd_deploy.figures.particles import in_slice
from gimpmd_deploy.results.fields import field_values
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.case.plan import Plan


@dataclass(frozen=True)
class Shown:
    """Particles of one time; the field is in ``fields`` of each set that has it.

    In three dimensions they are those that the plane in the middle of the body cuts.

    Attributes
    ----------
    points : material points outside the energy plane; None in a run of MD only.
    atoms : atoms that move freely; None in a run of the continuum only.
    followers : atoms that follow the continuum, which would show its field twice; None without.
    all_atoms : all atoms of the body, also outside the slice.
    """

    time: float
    points: Particles | None
    atoms: Particles | None
    followers: Particles | None
    all_atoms: Particles | None

    def sets(self) -> list[Particles]:
        """Material points and free atoms, as far as there are any."""
        return [p for p in (self.points, self.atoms) if p is not None and len(p)]


def show(run: Run, time: float, particles: Mapping[Any, Particles], name: str) -> Shown:
    """Choose what a figure of a field shows.

    Particles that follow the other side would show its values twice, and atoms at the edge of the
    region lack half of their neighbours.

    Parameters
    ----------
    particles : mapping
        ``run.particles(time)``.
    name : str
        The field.
    """
    plan, found = run.plan, {}
    for role, p in particles.items():
        values = field_values(p, name, plan.units)
        fields = {} if values is None else {name: values}
        found[role] = in_slice(replace(p, fields=fields), middle(plan))
    points, atoms, all_atoms = found.get("continuum"), found.get("md"), particles.get("md")
    if plan.coupling is None or points is None or atoms is None:
        return Shown(time, points, atoms, None, all_atoms)
    zones = plan.coupling.zones
    free = zones.depth(atoms.reference) >= zones.outer
    own = zones.depth(points.reference) < zones.energy_plane
    return Shown(time, points.where(own), atoms.where(free), atoms.where(~free), all_atoms)


def middle(plan: Plan) -> float:
    """Height of the slice: the middle of the body along z; unused in two dimensions."""
    low, high = plan.domain.box[-1]
    return 0.5 * (low + high)
