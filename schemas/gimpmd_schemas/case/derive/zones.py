"""Where the two sides meet: interfaces, zones with their default widths, planes."""

from __future__ import annotations

from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.regions import md_regions
from gimpmd_schemas.case.form import AT_PLANES, Case
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones, cut


def zones(case: Case) -> Zones:
    """Zones with the default widths filled in. A run of one side has no interface.

    Schemes with planes have only an outer zone, which holds the ghost atoms. As soon as the planes
    are known, all depths are measured from them.
    """
    h = finest_cell(case)
    layer = h / case.grid.points_per_axis
    widths, scheme = case.coupling.zones, case.coupling.scheme
    boxes = (case.domain.box,) if case.md is None else md_regions(case)
    faces = [_interface_faces(case, box) for box in boxes]
    outer = h if widths.outer is None else widths.outer
    if scheme in AT_PLANES:
        if case.coupling.planes is not None and case.only is None:
            outer = 0.0
            limits = [planes.limits(case.dim) for planes in case.coupling.each_planes().values()]
            boxes = tuple(cut(box, limit) for box, limit in zip(boxes, limits, strict=True))
        return Zones(
            tuple(map(MdRegion, boxes, faces)), outer, incommunicado=0.0, inner=0.0, filter=0.0
        )
    # "3 to 4 layers of material points" (paper section 4.1)
    buffer, inner = (4.0, 4.0) if scheme == "paper" else (0.0, 7.0)
    return Zones(
        regions=tuple(map(MdRegion, boxes, faces)),
        outer=outer,
        incommunicado=buffer * layer if widths.incommunicado is None else widths.incommunicado,
        inner=inner * layer if widths.inner is None else widths.inner,
        filter=2.0 * h if widths.filter is None else widths.filter,
    )


def _interface_faces(case: Case, box: Box) -> tuple[tuple[bool, bool], ...]:
    """Along each axis, whether the lower and the upper face of a box touch the continuum."""
    if case.only is not None:
        return ((False, False),) * case.dim
    eps = 1e-9 * finest_cell(case)
    return tuple(
        (abs(low - lo) > eps and not periodic, abs(high - hi) > eps and not periodic)
        for (low, high), (lo, hi), periodic in zip(
            box, case.domain.box, case.domain.periodic, strict=True
        )
    )


def interfaces_of(case: Case) -> tuple[Interface, ...]:
    """Interface of each MD region, in a scheme with planes.

    Raises
    ------
    ValueError
        LAMMPS has not found the planes yet.
    """
    if case.coupling.planes is None:
        raise ValueError("the planes of the interface have not been found yet")
    found, sites = case.coupling.each_planes().values(), case.coupling.sites
    second = [None] * len(found) if sites is None else [p.limits(case.dim) for p in sites.second]
    return tuple(
        Interface(planes.limits(case.dim), region, beyond, None if sites is None else sites.period)
        for planes, region, beyond in zip(found, md_regions(case), second, strict=True)
    )
