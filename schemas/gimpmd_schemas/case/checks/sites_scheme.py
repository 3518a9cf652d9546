"""What the sites scheme needs in addition to planes, and what it cannot do yet."""

from __future__ import annotations

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import FACES, Case

SECOND_GAP = 3.0
"""Least gap between a second plane and the faces of the domain, in finest cells: the points within
1.75 cells of the second planes are corrected, and one more cell must lie beyond them."""

FORCE = "coupling.scheme: force can do it, for sums over pairs"


def check_sites_scheme(case: Case, rules: Rules) -> None:
    """Codes, material, levels, and what LAMMPS has measured."""
    for key, value, known in (
        ("md.backend", case.atoms.backend, "lammps"),
        ("continuum.backend", case.continuum.backend, "gimp"),
    ):
        rules.require(
            value == known,
            key,
            value,
            "does not know the sites scheme",
            f"write {known}, or coupling.scheme: force",
        )
    rules.require(
        case.coupling.crystal is None,
        "coupling.crystal",
        "given",
        "belongs to the force scheme",
        "leave it out",
    )
    rules.require(
        case.dim == 2 or case.atoms.minimize or not _planes_end_at_faces(case),
        "md.minimize",
        case.atoms.minimize,
        "leaves the surface of the atoms, at a face of the body where planes end, without rest",
        "write true",
    )
    measured = case.coupling.sites is not None
    rules.require(
        measured == (case.coupling.planes is not None),
        "coupling.planes",
        "missing" if measured else "given",
        "and coupling.sites belong together",
        "leave out both: LAMMPS finds them",
    )
    if measured:
        _check_room(case, rules)


def _planes_end_at_faces(case: Case) -> bool:
    """Whether a region reaches a face of the body along one axis, and has planes along another."""
    for region in zones(case).regions:
        for axis, sides in enumerate(region.interfaces):
            others = any(any(pair) for k, pair in enumerate(region.interfaces) if k != axis)
            if others and not all(sides) and not case.domain.periodic[axis]:
                return True
    return False


def _check_room(case: Case, rules: Rules) -> None:
    """Check the room beyond the second planes."""
    sites, h = case.coupling.sites, finest_cell(case)
    if sites is None:
        return
    for key, planes in zip(case.atoms.boxes(), sites.second, strict=True):
        for axis, pair in enumerate(planes.limits(case.dim)):
            for side, plane in enumerate(pair):
                gap = abs(plane - case.domain.box[axis][side])
                rules.require(
                    gap >= SECOND_GAP * h * (1.0 - 1e-9),
                    key,
                    case.atoms.boxes()[key],
                    f"has its second plane at {plane:g}, within {gap:g} of the "
                    f"{FACES[2 * axis + side]} face of the body; it needs {SECOND_GAP * h:g}",
                    "move the region away from the face",
                )
