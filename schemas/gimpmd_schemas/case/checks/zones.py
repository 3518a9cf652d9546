"""The interface: gaps between MD regions, zones, absorber."""

from __future__ import annotations

from itertools import combinations

from gimpmd_schemas.case.checks.force_scheme import check_force_scheme
from gimpmd_schemas.case.checks.levels import check_finest_box
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.checks.sites_scheme import check_sites_scheme
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import AT_PLANES, FACES, Case
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones

REGIONS_GAP = 8.0
"""Least gap between MD regions, in finest cells: each needs its own continuum around it."""


def check_zones(case: Case, rules: Rules) -> None:
    """MD regions apart from each other, with zones of sufficient width and room around them."""
    if case.only is not None or case.md is None:
        return
    zones, finest = zones_of(case), finest_cell(case)
    key = "coupling.zones"
    for (region_key, box), region in zip(case.md.boxes().items(), zones.regions, strict=True):
        if not rules.require(
            any(any(pair) for pair in region.interfaces),
            region_key,
            box,
            "fills the domain, so that there is nothing to couple",
            "run it with --only md, or make the region smaller",
        ):
            return
    if not _check_gaps(case, case.md.boxes(), zones, rules):
        return
    at_planes = case.coupling.scheme in AT_PLANES
    if case.md.cutoff is not None and not (at_planes and case.coupling.zones.outer is None):
        rules.require(
            zones.outer >= case.md.cutoff * (1.0 - 1e-5),
            f"{key}.outer",
            zones.outer,
            f"is narrower than the potential's cutoff {case.md.cutoff:g}",
            f"make it at least {case.md.cutoff:g} (paper section 4.1)",
        )
    as_published = case.coupling.scheme == "paper"
    rules.require(
        case.continuum.integrator
        in (("auto", "musl", "usl") if as_published else ("auto", "musl")),
        "continuum.integrator",
        case.continuum.integrator,
        f"does not fit the {case.coupling.scheme} scheme, which needs velocities at half steps "
        "and little dissipation",
        "write auto or musl",
    )
    for name, width in (
        ("zones.filter", case.coupling.zones.filter),
        ("filter_rate", case.coupling.filter_rate),
    ):
        rules.require(
            width is None or not as_published,
            f"coupling.{name}",
            width,
            "belongs to the zone filter, which the scheme paper does not have",
            "leave it out, or write coupling.scheme: velocity",
        )
    check_finest_box(case, rules)
    if at_planes:
        check_force_scheme(case, rules)
        if case.coupling.scheme == "sites":
            check_sites_scheme(case, rules)
        return
    layer = finest / case.grid.points_per_axis
    rules.require(
        zones.inner >= 4.0 * layer * (1 - 1e-9),
        f"{key}.inner",
        zones.inner,
        f"is narrower than four layers of points ({4 * layer:g})",
        f"seven layers ({7 * layer:g}) are a good choice",
    )
    for region_key, region in zip(case.md.boxes(), zones.regions, strict=True):
        _check_room(case, zones, region_key, region, rules)


def _check_gaps(case: Case, boxes: dict[str, Box], zones: Zones, rules: Rules) -> bool:
    """Check that MD regions are apart from each other; returns whether they are.

    The check ends at the first problem.
    """
    need = max(REGIONS_GAP * finest_cell(case), 2.0 * zones.filter, case.atoms.cutoff or 0.0)
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        gap = max(max(q[0] - p[1], p[0] - q[1]) for p, q in zip(a, b, strict=True))
        if not rules.require(
            gap >= need * (1.0 - 1e-9),
            other,
            b,
            f"overlaps {one}" if gap < 0.0 else f"is only {gap:g} away from {one}",
            f"keep regions {need:g} apart, {REGIONS_GAP:g} finest cells and more, or merge the two",
        ):
            return False
    return True


def _check_room(case: Case, zones: Zones, key: str, region: MdRegion, rules: Rules) -> None:
    """Check that zones of the velocity scheme fit a region, with continuum around it."""
    for axis, name in enumerate("xy"):
        count = sum(region.interfaces[axis])
        low, high = region.box[axis]
        need = count * zones.innermost
        rules.require(
            count == 0 or high - low > need,
            "coupling.zones",
            f"outer {zones.outer:g}, incommunicado {zones.incommunicado:g}, inner {zones.inner:g}",
            f"do not fit the MD region along {name}: they need {need:g}, it is {high - low:g} wide",
            f"narrow the zones or widen {key}",
        )
        for side in range(2):
            gap = abs(region.box[axis][side] - case.domain.box[axis][side])
            need = max(zones.filter, 2.0 * finest_cell(case))
            rules.require(
                not region.interfaces[axis][side] or gap >= need * (1 - 1e-9),
                key,
                region.box,
                f"comes within {gap:g} of the domain's {FACES[2 * axis + side]} face; the "
                f"continuum between needs {need:g}",
                "end the region on the face, or move it away",
            )


def check_absorber(case: Case, rules: Rules) -> None:
    """The absorber belongs to the schemes with planes, and its numbers have the right sign."""
    absorber, key = case.coupling.absorber, "coupling.absorber"
    if absorber is None:
        return
    rules.require(
        case.coupling.scheme in AT_PLANES,
        key,
        "given",
        f"belongs to the schemes force and sites, not to coupling.scheme: {case.coupling.scheme}",
        "remove it, or write coupling.scheme: force",
    )
    for name in ("rate", "width"):
        value = getattr(absorber, name)
        rules.require(value is None or value > 0, f"{key}.{name}", value, "must be positive")
    for name in ("temperature", "seed"):
        value = getattr(absorber, name)
        rules.require(value >= 0, f"{key}.{name}", value, "must not be negative")
