"""What the user should know about a run before it starts."""

from __future__ import annotations

from gimpmd_schemas.case.derive import levels
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case, SchemeName
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import Box, MdRegion

SHORTEST = 3.85
"""Length, in cells, of the shortest wave that the grid carries."""

NEAR = 2.0
"""A level change nearer than this to the atoms, in the shortest waves of the coarser level, is
close. Waves that come back from there spread on their way if the region is no larger than that."""


def cautions(plan: Plan) -> list[str]:
    """Return what the user should know about a run before it starts."""
    coupling = plan.coupling
    if coupling is None:
        return []
    return [
        *_of_scheme(coupling.scheme),
        *_of_levels(
            coupling.absorber is not None,
            coupling.zones.regions,
            plan.level_boxes,
            plan.finest_cell,
        ),
    ]


def early_cautions(case: Case) -> list[str]:
    """Return the same for a case whose plan may need what only LAMMPS knows."""
    if case.only is not None or case.md is None:
        return []
    absorbed, h = case.coupling.absorber is not None, levels.finest_cell(case)
    return [
        *_of_scheme(case.coupling.scheme),
        *_of_levels(absorbed, zones(case).regions, levels.boxes(case), h),
    ]


def _of_scheme(scheme: SchemeName) -> list[str]:
    if scheme != "paper":
        return []
    return [
        "coupling.scheme: paper is unstable without damping (docs/theory.md): energy may grow "
        "at the interface; the schemes force and velocity are stable"
    ]


def _of_levels(
    absorbed: bool, regions: tuple[MdRegion, ...], boxes: tuple[tuple[Box, ...], ...], h: float
) -> list[str]:
    """Waves that leave the atoms, and come back from a level change close to them."""
    if not absorbed or len(boxes) == 1:
        return []
    longest, wide = 2.0 * SHORTEST * h, NEAR * 2.0 * SHORTEST * h
    gap = min((_gap(region, boxes[0][0], boxes[-1]) for region in regions), default=wide)
    if gap >= wide * (1.0 - 1e-9):
        return []
    return [
        f"grid.levels: a coarser level begins {gap:.4g} from the atoms; waves of length "
        f"{SHORTEST * h:.4g} to {longest:.4g} leave the atoms but are too short for it, and come "
        f"back, and the absorber takes a part of them only; keep level changes {wide:.4g} away "
        "if such waves matter"
    ]


def _gap(region: MdRegion, domain: Box, boxes: tuple[Box, ...]) -> float:
    """Least distance of an interface of a region from the end of the finest level."""
    gaps = []
    for box in boxes:
        sides = list(zip(region.box, box, domain, region.interfaces, strict=True))
        if not all(low >= start and high <= end for (low, high), (start, end), _, _ in sides):
            continue
        for ends, of_box, of_domain, interfaces in sides:
            gaps += [
                abs(ends[side] - of_box[side])
                for side in range(2)
                if interfaces[side] and of_box[side] != of_domain[side]
            ]
    return min(gaps, default=float("inf"))
