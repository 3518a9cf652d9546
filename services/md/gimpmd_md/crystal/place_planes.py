"""Where the planes of a region lie: midway between layers of atoms, as far out as ghosts allow."""

from __future__ import annotations

import msgspec
import numpy as np

from gimpmd_md.crystal.body_faces import Face, depth_of_layers, even
from gimpmd_md.crystal.plane_pairs import SHARES, pairs, reach
from gimpmd_md.crystal.plane_pairs import Planes as PlanePair
from gimpmd_md.crystal.recognise import Crystal
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.checks.force_scheme import LEAST_CORE
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import FACES, Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box, MdRegion

HALF = 1e-6
"""Largest accepted error of the half layer between the outermost atoms and a face of the body at
which planes end."""

PLACES, FARTHEST = 50, 4
"""Places in a cell, and cells on both sides, that are tried for a face that has no planes."""

WAY_OUT = "in two dimensions use coupling.scheme: velocity"


def place(
    case: Case, crystal: Crystal, key: str, region: MdRegion, script: str, cutoff: float
) -> tuple[Box, Box]:
    """Place the planes of a region, and the second planes: as far out as the ghosts allow.

    Parameters
    ----------
    key, script : str
        The region in the case, and what made its atoms; for messages.
    cutoff : float
        Range of the potential (length).

    Raises
    ------
    BackendError
        There is no place for them; the message gives a way out.
    """
    _check_layers(crystal, region, script)
    h, options = finest_cell(case), []
    for axis, side in _with_planes(region):
        face = region.box[axis][side]
        found = _pairs(case, crystal, cutoff, axis, side, face)
        if not found:
            raise BackendError(
                f"{key}: no plane midway between layers of atoms near its {FACES[2 * axis + side]} "
                f"face, at {face:g}, leaves {SHARES[0]:g} to {SHARES[1]:g} of its cell to the "
                f"continuum: {_ways_out(case, crystal, cutoff, axis, side, face)}"
            )
        options.append((axis, side, found))
    faces = _faces_with_planes(case, crystal, region, script)
    if faces and len(crystal.basis) > 1:
        raise BackendError(
            f"{script}: planes of {key} end at the {faces[0].name} face of the body, and the "
            f"crystal has {len(crystal.basis)} atoms in its primitive cell; surfaces of such "
            "crystals are not part of the sites scheme yet: let all faces of the region lie inside "
            "the body"
        )
    # moments of layers that end unevenly are known in two dimensions; if they cannot cancel, and
    # in three dimensions, the continuum does without balance under strains that load the face
    chosen = even(crystal, options, faces) if case.dim == 2 else None
    if chosen is None:
        chosen = [places[0] for _, _, places in options]
    first = [[-np.inf, np.inf] for _ in region.box]
    second = [[-np.inf, np.inf] for _ in region.box]
    for (axis, side, _), planes in zip(options, chosen, strict=True):
        first[axis][side], second[axis][side] = planes.first, planes.second
    for axis, (low, high) in enumerate(first):
        ends = max(low, region.box[axis][0]), min(high, region.box[axis][1])
        if any(region.interfaces[axis]) and ends[1] - ends[0] < LEAST_CORE * h * (1.0 - 1e-9):
            raise BackendError(
                f"{key}: is too narrow along {'xyz'[axis]}: its ghosts leave {ends[1] - ends[0]:g} "
                f"for free atoms, and they need {LEAST_CORE * h:g}; make it wider"
            )
    return tuple((low, high) for low, high in first), tuple((low, high) for low, high in second)


def layer(crystal: Crystal, axis: int) -> float:
    """Distance of the layers of atoms along an axis, or 0."""
    layers = crystal.layers(axis)
    return (layers and layers.spacing()) or 0.0


def _with_planes(region: MdRegion) -> list[tuple[int, int]]:
    """Axis and side of the faces of a region that have planes."""
    return [
        (axis, side)
        for axis, sides in enumerate(region.interfaces)
        for side in range(2)
        if sides[side]
    ]


def _check_layers(crystal: Crystal, region: MdRegion, script: str) -> None:
    for axis, _ in _with_planes(region):
        if not layer(crystal, axis):
            raise BackendError(
                f"{script}: the crystal has no evenly spaced layers normal to {'xyz'[axis]}; turn "
                f"it, or {WAY_OUT}"
            )


def _pairs(
    case: Case, crystal: Crystal, cutoff: float, axis: int, side: int, face: float
) -> list[PlanePair]:
    """Planes that a face of a region at some place may have; see `pairs`."""
    layers, spacing, h = crystal.layers(axis), layer(crystal, axis), finest_cell(case)
    if layers is None or not spacing:
        return []
    out = -1.0 if side == 0 else 1.0
    least = max(cutoff, case.coupling.zones.outer or 0.0)
    wanted = face - out * (least + reach(spacing, cutoff, h) + 0.5 * h)
    origin, offset = case.domain.box[axis][0], float(layers.midway()[0])
    return pairs(wanted, out, spacing, offset, cutoff, h, origin)


def _ways_out(
    case: Case, crystal: Crystal, cutoff: float, axis: int, side: int, face: float
) -> str:
    """The nearest place of a face and the nearest size of cells that have planes, as tried."""
    ways = []
    for x in _places_near(case, axis, face):
        if _pairs(case, crystal, cutoff, axis, side, x):
            ways.append(f"move it to {x:g}")
            break
    for cell in _cells_near(case):
        grid = msgspec.structs.replace(case.grid, cell=cell)
        other = msgspec.structs.replace(case, grid=grid)
        if not check_case(other) and _all_have(other, crystal, cutoff):
            ways.append(f"use grid.cell: {cell:.10g}")
            break
    return ", or ".join(ways) or "move the crystal against the node lines"


def _places_near(case: Case, axis: int, face: float) -> list[float]:
    """Other places of a face in the domain, the nearest ones first."""
    (low, high), step = case.domain.box[axis], finest_cell(case) / PLACES
    numbers = range(1, FARTHEST * PLACES + 1)
    places = [float(f"{face + sign * n * step:.6g}") for n in numbers for sign in (1.0, -1.0)]
    return [x for x in places if low < x < high]


def _cells_near(case: Case) -> list[float]:
    """Other cells of which the domain holds whole numbers along x, up to twice or half as large."""
    low, high = case.domain.box[0]
    count = round((high - low) / case.grid.cell)
    counts = [n for n in range(max(count // 2, 1), 2 * count + 1) if n != count]
    cells = [float(f"{(high - low) / n:.10g}") for n in counts]
    return sorted(cells, key=lambda cell: abs(cell - case.grid.cell))


def _all_have(case: Case, crystal: Crystal, cutoff: float) -> bool:
    """Whether all faces of all regions have planes."""
    if any((crystal.period(axis) or 0.0) > finest_cell(case) for axis in range(case.dim)):
        return False
    return all(
        _pairs(case, crystal, cutoff, axis, side, region.box[axis][side])
        for region in zones_of(case).regions
        for axis, side in _with_planes(region)
    )


def _faces_with_planes(case: Case, crystal: Crystal, region: MdRegion, script: str) -> list[Face]:
    """Faces of the body at which planes of a region end."""
    found = []
    for axis, sides in enumerate(region.interfaces):
        if not any(any(pair) for k, pair in enumerate(region.interfaces) if k != axis):
            continue
        for side in range(2):
            if sides[side] or case.domain.periodic[axis]:
                continue
            face = Face(axis, side, case.domain.box[axis][side])
            depth = depth_of_layers(crystal, face)
            if not abs(depth - 0.5) < HALF:
                raise BackendError(
                    f"{script}: planes end at the {face.name} face of the body, at "
                    f"{face.end:g}, which lies {depth:.3g} layers of atoms beyond the outermost "
                    "layer instead of half a layer; move the atoms or the face"
                )
            found.append(face)
    return found
