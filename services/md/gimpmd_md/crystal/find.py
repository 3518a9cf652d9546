"""The crystal of the user's atoms, and the planes of the force scheme.

Near the interface the atoms must form a perfect lattice with one atom in its primitive cell, and
the potential must be a sum over pairs. The planes between free atoms and continuum lie midway
between layers of the lattice.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from gimpmd_md.crystal import bonds, bravais
from gimpmd_md.crystal.bravais import ON_SITE, Lattice
from gimpmd_md.crystal.check import where
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import FACES, Case, Crystal, Planes
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import MdRegion

NEAR = 2.0
"""Depth below the planes, in cutoffs, to which the crystal must be perfect."""

FITTED = 1e-3
"""Largest misfit, in spacings, of the atoms to which the lattice is fitted."""

ROUNDING = 1e-12
"""Components of vectors below this, in spacings, are round-off."""

WAY_OUT = "set coupling.scheme: velocity"


def find(case: Case, engine: Engine, cutoff: float) -> tuple[Crystal, Planes | tuple[Planes, ...]]:
    """Find the crystal near the interface of a coupled case, and the planes of its MD regions.

    All regions hold the same crystal. The planes are returned as in ``coupling.planes``.

    Parameters
    ----------
    engine : Engine
        With the atoms at rest at their lattice positions, on one rank.
    cutoff : float
        Range of the pair potential (length).

    Raises
    ------
    BackendError
        The atoms do not suit the force scheme; the message says where, and gives a way out.
    """
    script = case.atoms.input
    if not engine.is_of_distance():
        styles = ", ".join(engine.pair_styles())
        raise BackendError(
            f"{script}: gimpmd does not know pair_style {styles} as a sum over pairs without "
            f"charges, which the force scheme needs; {WAY_OUT}"
        )
    zones = zones_of(case)
    least = max(cutoff, case.coupling.zones.outer or 0.0)
    x = _wrapped(case, engine.vectors("x"))
    near = zones.depth(x) < least + cutoff
    lattice = _lattice(case, x[near], least)
    _check_on_sites(lattice, x[near], script)
    near, planes = np.zeros(len(x), dtype=np.bool_), []
    for key, region in zip(case.atoms.boxes(), zones.regions, strict=True):
        planes.append(
            {
                FACES[2 * axis + side]: _plane(case, lattice, key, region, axis, side, least)
                for axis, sides in enumerate(region.interfaces)
                for side in range(2)
                if sides[side]
            }
        )
        core = _core(key, region, planes[-1], script)
        depth = core.depth(x)
        by_it = (depth > -(1.0 - ON_SITE) * cutoff) & (depth < NEAR * cutoff)
        _check_on_sites(lattice, x[by_it], script)
        _check_occupied(case, lattice, x[by_it], core, cutoff)
        near |= by_it
    kind = _one_kind(engine, near, script)
    try:
        found = bonds.best(engine, kind, lattice.vectors, cutoff)
    except BackendError as error:
        raise BackendError(f"{script}: {error}; {WAY_OUT}") from None
    crystal = Crystal(
        vectors=(_pair(lattice.vectors[0]), _pair(lattice.vectors[1])),
        origin=_pair(lattice.origin),
        bonds=pairs(found.vectors),
        energy=tuple(tuple(c.tolist()) for c in found.energy),
        stretch_limit=found.stretch_limit,
    )
    found_planes = tuple(Planes(**of_region) for of_region in planes)
    return crystal, found_planes if case.atoms.regions else found_planes[0]


def pairs(x: Floats) -> tuple[tuple[float, float], ...]:
    """Vectors ``(n, 2)`` in the form of the case file."""
    return tuple(_pair(row) for row in x)


def _pair(x: Floats) -> tuple[float, float]:
    return float(x[0]), float(x[1])


def _wrapped(case: Case, x: Floats) -> Floats:
    """Move positions at the upper end of a periodic axis to its lower end."""
    x, eps = x.copy(), ON_SITE * finest_cell(case)
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            x[:, axis] = low + (x[:, axis] - low + eps) % (high - low) - eps
    return x


def _lattice(case: Case, x: Floats, least: float) -> Lattice:
    """Lattice of the atoms ``x (n, 2)`` near the interface, found from the neighbours of one."""
    script, region = case.atoms.input, zones_of(case).regions[0]
    if x.shape[0] == 0:
        raise BackendError(f"{script}: makes no atoms near the interface of md.region")
    seed = x[np.argmin(np.hypot(*(x - _middle_of_a_face(region, least)).T))]
    away = x - seed
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            period = (high - low) * np.eye(2)[axis]
            away = np.concatenate([away - period, away, away + period])
    vectors = bravais.primitive(away[np.hypot(*away.T) > 0.0])
    if vectors is None:
        raise BackendError(
            f"{script}: the atoms near {where(seed)} do not form a lattice; {WAY_OUT}"
        )
    lattice = Lattice(vectors, seed)
    good = x[lattice.misfit(x) < FITTED]
    unknowns = np.column_stack([lattice.numbers(good), np.ones(len(good))])
    if np.linalg.matrix_rank(unknowns) == 3:
        fitted = np.linalg.lstsq(unknowns, good, rcond=None)[0]
        fitted[np.abs(fitted) < ROUNDING * lattice.spacing] = (
            0.0  # rows along an axis stay along it
        )
        lattice = Lattice(np.asarray(fitted[:2], float), np.asarray(fitted[2], float))
    return lattice


def _middle_of_a_face(region: MdRegion, depth: float) -> Floats:
    """A point at a depth below the middle of the first interface."""
    middle = np.array([0.5 * (low + high) for low, high in region.box])
    axis, side = next((a, s) for a in range(2) for s in range(2) if region.interfaces[a][s])
    middle[axis] = region.box[axis][side] + (depth if side == 0 else -depth)
    return middle


def _plane(
    case: Case,
    lattice: Lattice,
    key: str,
    region: MdRegion,
    axis: int,
    side: int,
    least: float,
) -> float:
    """Plane of a face: of all deep enough, the one whose cell holds most continuum.

    The candidates lie up to a cell and a layer deeper than the shallowest plane. The best one is
    closest beyond a node line, going outward.
    """
    script, h = case.atoms.input, finest_cell(case)
    face, out = region.box[axis][side], -1.0 if side == 0 else 1.0
    layer = bravais.layer_spacing(lattice.vectors, axis)
    if layer == np.inf:
        raise BackendError(
            f"{script}: the crystal has no rows of atoms along the {FACES[2 * axis + side]} face "
            f"of {key}; turn it, or {WAY_OUT}"
        )
    first = lattice.origin[axis] + 0.5 * layer
    steps = np.floor((face - out * least * (1.0 - ON_SITE) - first) * out / layer)
    shallowest = first + out * steps * layer
    planes = shallowest - out * layer * np.arange(int(h / layer + 1e-9) + 2)
    beyond = (planes - case.domain.box[axis][0]) * out / h % 1.0
    beyond = np.where(beyond > 1.0 - ON_SITE, 0.0, np.round(beyond / ON_SITE))
    return float(planes[np.argmin(beyond)])


def _core(key: str, region: MdRegion, planes: dict[str, float], script: str) -> MdRegion:
    """The region inside the planes, from which depth is measured."""
    box = []
    for axis, (start, end) in enumerate(region.box):
        low, high = planes.get(FACES[2 * axis], start), planes.get(FACES[2 * axis + 1], end)
        if low >= high:
            raise BackendError(
                f"{script}: {key} is too narrow along {'xy'[axis]} for the planes of the force "
                f"scheme, which lie one cutoff inside its faces; make it wider by more than "
                f"{low - high:g}, or {WAY_OUT}"
            )
        box.append((low, high))
    return replace(region, box=tuple(box))


def _check_on_sites(lattice: Lattice, x: Floats, script: str) -> None:
    misfit = lattice.misfit(x)
    worst = int(np.argmax(misfit))
    if misfit[worst] > ON_SITE:
        raise BackendError(
            f"{script}: the atom at {where(x[worst])} is {misfit[worst] * lattice.spacing:.3g} "
            f"off the lattice of its neighbours; near the interface the force scheme needs a "
            f"perfect crystal of one atom per primitive cell; {WAY_OUT}"
        )


def _check_occupied(case: Case, lattice: Lattice, x: Floats, core: MdRegion, cutoff: float) -> None:
    """Check that every site near the planes has an atom, up to the rim of the domain."""
    script, eps = case.atoms.input, ON_SITE * lattice.spacing
    if len(np.unique(lattice.numbers(x), axis=0)) < len(x):
        raise BackendError(f"{script}: two atoms occupy one lattice site near the interface")
    sites = _empty_sites(lattice, x, cutoff, core)
    depth = core.depth(sites)
    missing = (depth > -(cutoff - eps)) & (depth < NEAR * cutoff - eps)
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:  # half-open, as positions are
            missing &= (sites[:, axis] > low - eps) & (sites[:, axis] < high - 2.0 * eps)
            continue
        at_low, at_high = core.interfaces[axis]
        missing &= at_low | (sites[:, axis] > x[:, axis].min() - eps)
        missing &= at_high | (sites[:, axis] < x[:, axis].max() + eps)
    if missing.any():
        raise BackendError(
            f"{script}: no atom at {where(sites[missing][0])}, a site of the crystal near the "
            f"interface, where the force scheme needs a perfect one; {WAY_OUT}"
        )


def _empty_sites(lattice: Lattice, x: Floats, cutoff: float, core: MdRegion) -> Floats:
    """Sites without an atom in and around the core, shape ``(m, 2)``."""
    grown = [(low - cutoff, high + cutoff) for low, high in core.box]
    n = lattice.numbers(np.concatenate([x, np.array(list(product(*grown)))])).astype(np.int64)
    first = n.min(axis=0)
    taken = np.zeros(n.max(axis=0) - first + 1, dtype=np.bool_)
    taken[tuple((n[: len(x)] - first).T)] = True
    return np.asarray(lattice.origin + (np.argwhere(~taken) + first) @ lattice.vectors)


def _one_kind(engine: Engine, near: Bools, script: str) -> int:
    """LAMMPS type of the atoms near the interface; all must have the same type and mass."""
    kinds, masses = np.unique(engine.atoms("type")[near]), np.unique(engine.masses()[near])
    if len(kinds) > 1 or len(masses) > 1:
        raise BackendError(
            f"{script}: near the interface the atoms are of types {', '.join(map(str, kinds))} and "
            f"masses {', '.join(f'{m:g}' for m in masses)}; there the force scheme needs one type "
            f"and one mass; {WAY_OUT}"
        )
    return int(kinds[0])
