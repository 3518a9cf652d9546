"""What the schemes with planes need: the force scheme, and the sites scheme."""

from __future__ import annotations

from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import FACES, Case
from gimpmd_schemas.grid.zones import Box, MdRegion

REGION_GAP = 2.0
"""Least gap between an MD region and the faces of the domain, in finest cells: ghost atoms touch
nodes one cell away."""

PLANE_GAP = 3.0
"""Least gap between a plane and the faces of the domain, in finest cells: one cell of corrected
points and two of others."""

LEAST_CORE = 2.0
"""Least distance of opposite planes, in finest cells."""


def check_force_scheme(case: Case, rules: Rules) -> None:
    """Keys of the velocity scheme, interpolation, and room on both sides of the planes."""
    widths, scheme = case.coupling.zones, case.coupling.scheme
    for key, value in (
        ("coupling.zones.incommunicado", widths.incommunicado),
        ("coupling.zones.inner", widths.inner),
        ("coupling.zones.filter", widths.filter),
        ("coupling.filter_rate", case.coupling.filter_rate),
    ):
        rules.require(
            value is None,
            key,
            value,
            f"belongs to the velocity scheme; the {scheme} scheme has no such zone and no filter",
            "leave it out, or write coupling.scheme: velocity",
        )
    continuum = case.continuum
    rules.require(
        continuum.interpolation in ("ugimp", "linear"),
        "continuum.interpolation",
        continuum.interpolation,
        f"does not fit the {scheme} scheme, whose points keep their initial shape functions",
        "write ugimp or linear, or coupling.scheme: velocity",
    )
    boxes, regions = case.atoms.boxes(), zones(case).regions
    if case.coupling.planes is None:
        for key, region in zip(boxes, regions, strict=True):
            _check_region(case, key, region, rules)
        return
    found = case.coupling.each_planes()
    for key, box, interfaces in zip(
        found, boxes.values(), [region.interfaces for region in regions], strict=True
    ):
        _check_planes(case, key, box, interfaces, rules)


def _check_region(case: Case, key: str, region: MdRegion, rules: Rules) -> None:
    """Check an MD region before LAMMPS has found its planes."""
    h = finest_cell(case)
    cutoff = case.atoms.cutoff or 0.0
    for axis, name in enumerate(AXES[: case.dim]):
        low, high = region.box[axis]
        need = sum(region.interfaces[axis]) * cutoff + LEAST_CORE * h
        rules.require(
            not any(region.interfaces[axis]) or high - low >= need * (1.0 - 1e-9),
            key,
            region.box,
            f"is {high - low:g} wide along {name}; ghost atoms within the cutoff {cutoff:g} of its "
            f"faces and {LEAST_CORE:g} cells of free atoms need {need:g}",
            f"widen {key}",
        )
        for side in range(2):
            gap = abs(region.box[axis][side] - case.domain.box[axis][side])
            rules.require(
                not region.interfaces[axis][side] or gap >= REGION_GAP * h * (1.0 - 1e-9),
                key,
                region.box,
                f"comes within {gap:g} of the domain's {FACES[2 * axis + side]} face; the "
                f"continuum between needs {REGION_GAP * h:g}",
                "end the region on the face, or move it away",
            )


def _check_planes(
    case: Case,
    planes_key: str,
    box: Box,
    interfaces: tuple[tuple[bool, bool], ...],
    rules: Rules,
) -> None:
    """Check that planes lie at all interfaces, with free atoms inside and continuum outside."""
    planes, h = case.coupling.each_planes()[planes_key], finest_cell(case)
    for axis in range(case.dim):
        found = []
        for side in range(2):
            name = FACES[2 * axis + side]
            plane, key = getattr(planes, name), f"{planes_key}.{name}"
            inner, outer = box[axis], case.domain.box[axis][side]
            if not rules.require(
                (plane is not None) == interfaces[axis][side],
                key,
                plane,
                "missing at an interface" if plane is None else "there is no interface",
                "leave coupling.planes out: LAMMPS finds them",
            ):
                continue
            if plane is None:
                found.append(inner[side])
                continue
            found.append(plane)
            rules.require(
                inner[0] < plane < inner[1],
                key,
                plane,
                f"lies outside md.region, [{inner[0]:g}, {inner[1]:g}]",
                "leave coupling.planes out: LAMMPS finds them",
            )
            rules.require(
                abs(plane - outer) >= PLANE_GAP * h * (1.0 - 1e-9),
                key,
                plane,
                f"comes within {abs(plane - outer):g} of the domain's {name} face; the continuum "
                f"between needs {PLANE_GAP * h:g}",
                "end md.region on the face, or move it away",
            )
        if len(found) == 2:
            rules.require(
                found[1] - found[0] >= LEAST_CORE * h * (1.0 - 1e-9),
                planes_key,
                found,
                f"leave free atoms less than {LEAST_CORE:g} cells ({LEAST_CORE * h:g}) along "
                f"{AXES[axis]}",
                "widen md.region",
            )
