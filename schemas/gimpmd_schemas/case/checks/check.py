"""What a case means: geometry, stability, files. All problems are found before any run."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from itertools import combinations
from math import prod
from pathlib import Path
from typing import Literal

import msgspec

from gimpmd_schemas.case.checks.body import check_cracks, check_material
from gimpmd_schemas.case.checks.configuration import check_configuration
from gimpmd_schemas.case.checks.force_scheme import check_force_scheme
from gimpmd_schemas.case.checks.levels import check_finest_box, check_levels
from gimpmd_schemas.case.checks.loads import (
    check_body_force,
    check_damping,
    check_faces,
    check_initial,
)
from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.form import FACES, USUAL_CFL, Case, Material, Md
from gimpmd_schemas.errors import Problem
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones

MAX_CFL = 1.0
"""Largest accepted ``c dt / h``; that at which USAVG and MUSL get unstable is 1.66 with four points
to a cell and direction and more with fewer, 1.17 with corrected dispersion; 0.4 is usual."""

MAX_CELLS = 10**9
"""Largest accepted number of cells: beyond it the nodes alone fill any machine's memory."""

HUGE = 1e100
"""Numbers above it, or closer to zero than its inverse, are slips; products of them overflow."""

REGIONS_GAP = 8.0
"""Finest cells between MD regions: each has its own continuum about it, corrected and filtered."""

MAX_MD_FREQUENCY_STEP = 0.5
"""Largest accepted ``omega_max dt`` of the atoms; velocity Verlet breaks at 2."""


def check_case(case: Case, folder: Path | None = None) -> list[Problem]:
    """Everything that can be said of a case without starting anything.

    Parameters
    ----------
    case : Case
    folder : Path, optional
        Where its LAMMPS scripts lie; without it files are not looked at.

    Returns
    -------
    list of Problem
        Empty when the case can be run.
    """
    rules = Rules()
    _check_numbers(case, rules)
    _check_sides(case, rules)
    _check_lengths(case, rules)
    if not rules.problems:  # geometry on senseless numbers would only add noise
        check_material(case, rules)
        check_configuration(case, rules)
        check_faces(case, rules)
        check_body_force(case, rules)
        check_damping(case, rules)
        check_initial(case, rules)
        if _check_geometry(case, rules) and check_levels(case, rules):
            _check_size(case, rules)
            _check_zones(case, rules)
            _check_absorber(case, rules)
            _check_patches(case, rules)
            check_cracks(case, rules)
    if isinstance(case.continuum.material, Material) and not rules.problems:
        rules.problems += check_stability(case)
    if folder is not None:
        _check_files(case, folder, rules)
    return rules.problems


def cautions(case: Case) -> list[str]:
    """What should be known of a valid case before it is run."""
    if case.only is None and case.coupling.scheme == "paper":
        return [
            "coupling.scheme: paper is unstable without damping (docs/theory.md): energy may grow "
            "at the interface; velocity and force do not have this"
        ]
    return []


def _check_numbers(case: Case, rules: Rules) -> None:
    for key, value in _numbers(msgspec.to_builtins(case)):
        rules.require(
            value == 0.0 or 1.0 / HUGE <= abs(value) <= HUGE,
            key,
            value,
            f"must be a number between {1 / HUGE:g} and {HUGE:g} in size",
        )
    positive: list[tuple[str, float | None]] = [
        ("grid.cell", case.grid.cell),
        ("time.end", case.time.end),
        ("time.md_timestep", case.time.md_timestep),
        ("output.interval", case.output.interval),
        ("grid.points_per_axis", case.grid.points_per_axis),
        ("continuum.ranks", case.continuum.ranks),
    ]
    if case.time.md_steps != "auto":
        positive.append(("time.md_steps", case.time.md_steps))
    if case.time.step != "auto":
        positive.append(("time.step", case.time.step))
    if case.continuum.threads != "auto":
        positive.append(("continuum.threads", case.continuum.threads))
    if case.output.energy_interval is not None:
        positive.append(("output.energy_interval", case.output.energy_interval))
    if case.md is not None:
        positive += [("md.ranks", case.md.ranks), ("md.cutoff", case.md.cutoff)]
    for key, number in positive:
        rules.require(number is None or number > 0, key, number, "must be positive")
    for name in ("outer", "inner", "filter"):
        width = getattr(case.coupling.zones, name)
        key = f"coupling.zones.{name}"
        rules.require(width is None or width > 0, key, width, "must be positive")
    width = case.coupling.zones.incommunicado
    rules.require(
        width is None or width >= 0,
        "coupling.zones.incommunicado",
        width,
        "must not be negative",
    )
    rules.require(
        case.coupling.filter_rate is None or case.coupling.filter_rate >= 0,
        "coupling.filter_rate",
        case.coupling.filter_rate,
        "must not be negative",
    )
    xpic = case.continuum.xpic
    rules.require(xpic.order >= 1, "continuum.xpic.order", xpic.order, "must be at least 1")
    rules.require(
        xpic.every == "auto" or xpic.every >= 0,
        "continuum.xpic.every",
        xpic.every,
        "must not be negative",
    )
    flip = case.continuum.flip
    rules.require(
        0.0 <= flip <= 1.0,
        "continuum.flip",
        flip,
        "must be a share between 0 (PIC) and 1 (FLIP)",
    )
    rules.require(
        re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", case.name) is not None,
        "name",
        case.name,
        "must be fit for a folder's name: letters A-Z a-z, digits and . _ - alone",
    )


def _numbers(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    """All floating-point numbers in a case, with their keys."""
    if isinstance(value, float):
        yield key, value
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _numbers(item, f"{key}.{name}" if key else name)
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{key}[{index}]")


def _check_sides(case: Case, rules: Rules) -> None:
    """Which sides take part, and what each of them needs."""
    rules.require(
        case.dim == 2 or case.only == "continuum",
        "domain.box",
        case.domain.box,
        "is three-dimensional, and the atoms' side is two-dimensional for now",
        "write only: continuum, or run with --only continuum",
    )
    if case.md is None:
        rules.require(
            case.only == "continuum",
            "md",
            None,
            "missing, and the run has atoms",
            "describe the atoms, or write only: continuum",
        )
        for key, absent in (
            ("md_timestep", case.time.md_timestep is None),
            ("md_steps", case.time.md_steps == "auto"),
        ):
            rules.require(
                absent,
                f"time.{key}",
                getattr(case.time, key),
                "belongs to the atoms, and the case has no md",
                "write time.step, the step of the finest level, or leave it to auto",
            )
        return
    _check_region_keys(case, case.md, rules)
    rules.require(
        case.time.md_timestep is not None,
        "time.md_timestep",
        None,
        "missing",
        "give the time step of the atoms",
    )
    rules.require(
        case.time.step == "auto",
        "time.step",
        case.time.step,
        "is set by the atoms, as time.md_steps times time.md_timestep",
        "leave it out, or leave md out of a case of the continuum alone",
    )


def _check_region_keys(case: Case, md: Md, rules: Rules) -> None:
    """One region or several, and planes for each if there are any."""
    if not rules.require(
        md.region is not None or bool(md.regions),
        "md.region",
        None,
        "missing",
        "give the box of the atoms, or md.regions, a list of boxes",
    ) or not rules.require(
        md.region is None or not md.regions,
        "md.regions",
        md.regions,
        "comes beside md.region, and one of the two says where atoms are",
        "leave one out",
    ):
        return
    planes, count = case.coupling.planes, len(md.boxes())
    given = len(case.coupling.each_planes())
    rules.require(
        planes is None or given == count,
        "coupling.planes",
        given,
        f"are not the planes of {count} MD region{'s' if count > 1 else ''}",
        "leave them out: LAMMPS finds them",
    )


def _check_lengths(case: Case, rules: Rules) -> None:
    """Whatever has one entry for each axis has as many as the domain."""
    dim, continuum = case.dim, case.continuum
    per_axis: list[tuple[str, Sequence[object] | None]] = [
        ("domain.periodic", case.domain.periodic),
        *(case.md.boxes().items() if case.md else ()),
        ("md.patches", None if not case.md or case.md.patches == "auto" else case.md.patches),
        ("continuum.patches", None if continuum.patches == "auto" else continuum.patches),
    ]
    for k, level in enumerate(case.grid.levels):
        for j, box in enumerate(level.boxes):
            per_axis.append((f"grid.levels[{k}].boxes[{j}]", box))
    for index, crack in enumerate(continuum.cracks):
        key = f"continuum.cracks[{index}]"
        per_axis += [(f"{key}.from", crack.start), (f"{key}.to", crack.end)]
        per_axis.append((f"{key}.along", crack.along))
    for index, damping in enumerate(continuum.damping):
        per_axis.append((f"continuum.damping[{index}].box", damping.box))
    if continuum.body_force:
        per_axis.append(("continuum.body_force.acceleration", continuum.body_force.acceleration))
    for index, name in enumerate(FACES[: 2 * dim]):
        value = case.boundary.face(*divmod(index, 2)).value
        per_axis.append((f"boundary.{name}.value", value or None))
    for index, field in enumerate(case.initial.velocities):
        key = f"initial.velocities[{index}]"
        per_axis += [(f"{key}.velocity", field.velocity), (f"{key}.box", field.box)]
        per_axis += [(f"{key}.center", field.center), (f"{key}.gradient", field.gradient)]
        for i, row in enumerate(field.gradient or ()):
            per_axis.append((f"{key}.gradient[{i}]", row))
    if case.initial.stretch:
        stretch = case.initial.stretch
        per_axis += [("initial.stretch.gradient", stretch.gradient)]
        per_axis += [("initial.stretch.center", stretch.center)]
        for i, row in enumerate(stretch.gradient):
            per_axis.append((f"initial.stretch.gradient[{i}]", row))
    for key, entries in per_axis:
        rules.require(
            entries is None or len(entries) == dim,
            key,
            entries,
            f"must have {dim} entries, as domain.box has",
            f"write one for each of {', '.join(AXES[:dim])}",
        )


def _check_geometry(case: Case, rules: Rules) -> bool:
    """Domain, cells and MD region; says whether they make sense."""
    before = len(rules.problems)
    h = case.grid.cell
    for axis, name in enumerate(AXES[: case.dim]):
        low, high = case.domain.box[axis]
        if not rules.require(
            high > low,
            "domain.box",
            case.domain.box,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        ):
            continue
        cells = (high - low) / h
        rules.require(
            abs(cells - round(cells)) < 1e-6 and round(cells) >= 1,
            "grid.cell",
            h,
            f"does not divide the domain along {name}: {high - low:g} / {h:g} = {cells:.6g} cells",
            f"a cell of {(high - low) / max(1, round(cells)):.9g} would",
        )
        if case.md is not None:
            for key, region in case.md.boxes().items():
                _check_region(case, region, key, axis, rules)
    rules.require(
        case.grid.points_per_axis in (1, 2, 3, 4),
        "grid.points_per_axis",
        case.grid.points_per_axis,
        "must be 1, 2, 3 or 4",
    )
    first = case.time.md_timestep
    rules.require(
        first is None or case.time.end >= first,
        "time.end",
        case.time.end,
        "comes before the first MD step",
        f"at least {first:g}, one time.md_timestep" if first else "",
    )
    rules.require(
        case.continuum.interpolation != "cpgimp" or case.grid.points_per_axis > 1,
        "continuum.interpolation",
        case.continuum.interpolation,
        "needs room for the points to stretch within a cell",
        "set grid.points_per_axis to 2 or more, or take ugimp",
    )
    return len(rules.problems) == before


def _check_region(case: Case, region: Box, key: str, axis: int, rules: Rules) -> None:
    """An MD region inside the domain along an axis."""
    (low, high), (rlow, rhigh), name = case.domain.box[axis], region[axis], AXES[axis]
    if not rules.require(
        rhigh > rlow,
        key,
        region,
        f"upper {name} is not above lower {name}",
        f"write {name} as [lower, upper]",
    ):
        return
    eps = 1e-9 * case.grid.cell
    inside = rlow >= low - eps and rhigh <= high + eps
    rules.require(
        inside,
        key,
        region,
        f"leaves the domain along {name}: [{low:g}, {high:g}]",
        "move the region inside the domain",
    )
    if case.domain.periodic[axis] and inside:
        spans = abs(rlow - low) < eps and abs(rhigh - high) < eps
        rules.require(
            spans,
            key,
            region,
            f"must span the whole domain along the periodic axis {name}",
            f"set it to [{low:g}, {high:g}] along {name}",
        )


def _check_size(case: Case, rules: Rules) -> None:
    """No more cells than any machine's memory holds."""
    cells = sum(
        prod((high - low) / h for low, high in box)
        for h, boxes in zip(case.level_cells(), case.level_boxes(), strict=True)
        for box in boxes
    )
    rules.require(
        cells <= MAX_CELLS,
        "grid.cell",
        case.grid.cell,
        f"makes {cells:.3g} cells, more than {MAX_CELLS:g}",
        "make the cell larger, or the domain or its refined boxes smaller",
    )
    shared = prod((high - low) / case.finest_cell() for low, high in case.domain.box)
    rules.require(
        case.only == "continuum" or shared <= MAX_CELLS,
        "grid.levels",
        len(case.grid.levels),
        f"makes {shared:.3g} finest cells in the domain, over which both sides count their "
        f"nodes; more than {MAX_CELLS:g}",
        "refine less, or make grid.cell larger",
    )


def _check_zones(case: Case, rules: Rules) -> None:
    if case.only is not None or case.md is None:
        return
    zones, finest = case.zones(), case.finest_cell()
    key = "coupling.zones"
    for (region_key, box), region in zip(case.md.boxes().items(), zones.regions, strict=True):
        if not rules.require(
            any(any(pair) for pair in region.interfaces),
            region_key,
            box,
            "fills the domain, so there is nothing to couple",
            "run it with --only md, or make the region smaller",
        ):
            return
    if not _check_gaps(case, case.md.boxes(), zones, rules):
        return
    force = case.coupling.scheme == "force"
    if case.md.cutoff is not None and not (force and case.coupling.zones.outer is None):
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
        f"does not fit the {case.coupling.scheme} scheme, which wants velocities at half steps and "
        "little loss",
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
            "is of the zone filter, which the scheme paper does not have",
            "leave it out, or write coupling.scheme: velocity",
        )
    check_finest_box(case, rules)
    if force:
        check_force_scheme(case, rules)
        return
    layer = finest / case.grid.points_per_axis
    rules.require(
        zones.inner >= 4.0 * layer * (1 - 1e-9),
        f"{key}.inner",
        zones.inner,
        f"is narrower than four layers of points ({4 * layer:g})",
        f"seven layers ({7 * layer:g}) are a sound choice",
    )
    for region_key, region in zip(case.md.boxes(), zones.regions, strict=True):
        _check_room(case, zones, region_key, region, rules)


def _check_gaps(case: Case, boxes: dict[str, Box], zones: Zones, rules: Rules) -> bool:
    """MD regions keep apart from each other; to the first fault, says if there is none."""
    need = max(REGIONS_GAP * case.finest_cell(), 2.0 * zones.filter, case.atoms.cutoff or 0.0)
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        gap = max(max(q[0] - p[1], p[0] - q[1]) for p, q in zip(a, b, strict=True))
        if not rules.require(
            gap >= need * (1.0 - 1e-9),
            other,
            b,
            f"overlaps {one}" if gap < 0.0 else f"comes within {gap:g} of {one}",
            f"keep regions {need:g} apart, {REGIONS_GAP:g} finest cells and more, or make one of "
            "the two",
        ):
            return False
    return True


def _check_room(case: Case, zones: Zones, key: str, region: MdRegion, rules: Rules) -> None:
    """Zones of the velocity scheme fit a region, and the continuum between it and the rim."""
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
            need = max(zones.filter, 2.0 * case.finest_cell())
            rules.require(
                not region.interfaces[axis][side] or gap >= need * (1 - 1e-9),
                key,
                region.box,
                f"comes within {gap:g} of the domain's {FACES[2 * axis + side]} face; the "
                f"continuum between needs {need:g}",
                "end the region on the face, or move it away",
            )


def _check_absorber(case: Case, rules: Rules) -> None:
    absorber, key = case.coupling.absorber, "coupling.absorber"
    if absorber is None:
        return
    rules.require(
        case.coupling.scheme == "force",
        key,
        f"rate {absorber.rate:g}",
        f"belongs to the force scheme, not to coupling.scheme: {case.coupling.scheme}",
        "remove it, or write coupling.scheme: force",
    )
    rules.require(absorber.rate > 0, f"{key}.rate", absorber.rate, "must be positive")
    rules.require(
        absorber.width is None or absorber.width > 0,
        f"{key}.width",
        absorber.width,
        "must be positive",
    )
    for name in ("temperature", "seed"):
        value = getattr(absorber, name)
        rules.require(value >= 0, f"{key}.{name}", value, "must not be negative")


def _check_patches(case: Case, rules: Rules) -> None:
    if case.only != "continuum":
        cells = prod(high - low for low, high in case.md_region()) / case.finest_cell() ** 2
        rules.require(
            case.atoms.ranks <= max(1.0, cells),
            "md.ranks",
            case.atoms.ranks,
            f"are more than the {cells:.4g} cells of the MD region",
            "a rank wants hundreds of atoms; use fewer",
        )
        _check_tiling("md", case.atoms.patches, case.atoms.ranks, rules)
    if case.only == "md":
        return
    counts = [round((high - low) / case.grid.cell) for low, high in case.domain.box]
    ranks = case.continuum.ranks
    if not rules.require(
        ranks <= prod(counts),
        "continuum.ranks",
        ranks,
        f"are more than the {prod(counts)} cells of level 0",
        "a rank wants thousands of points; use fewer",
    ):
        return
    if not _check_tiling("continuum", case.continuum.patches, ranks, rules):
        return
    patches = case.continuum_patches()
    rules.require(
        all(p <= n for p, n in zip(patches, counts, strict=True)),
        "continuum.patches",
        list(patches),
        f"are more than the {' x '.join(map(str, counts))} cells of level 0 along an axis",
        "use fewer ranks, or give patches that leave each a cell",
    )


def _check_tiling(
    side: str, patches: tuple[int, ...] | Literal["auto"], ranks: int, rules: Rules
) -> bool:
    return patches == "auto" or rules.require(
        min(patches) >= 1 and prod(patches) == ranks,
        f"{side}.patches",
        list(patches),
        f"do not tile the region over {side}.ranks = {ranks}: "
        f"{' x '.join(map(str, patches))} = {prod(patches)}",
        "let the product be the number of ranks, or write auto",
    )


def check_stability(case: Case, spacing: float | None = None) -> list[Problem]:
    """Time steps against the CFL condition and the fastest vibration of the lattice.

    Parameters
    ----------
    spacing : float, optional
        Distance of neighbouring atoms, or ``sqrt(area per atom)``, which is 7 % less in a hexagonal
        crystal and so on the safe side; without it the MD time step is not checked.
    """
    rules = Rules()
    dt, h, c = case.step(), case.finest_cell(), case.wave_speed("P")
    if case.only != "md":  # on every level, since steps and cells double together
        key, value, hint = _step_key(case, c)
        rules.require(
            c * dt / h <= MAX_CFL,
            key,
            value,
            f"makes the continuum step {dt:g} unstable: c dt / h = {c * dt / h:.3g} > {MAX_CFL:g}",
            hint,
        )
    absorber = case.coupling.absorber
    if absorber is not None:
        rules.require(
            absorber.rate * dt <= 1.0,
            "coupling.absorber.rate",
            absorber.rate,
            f"takes more than all motion in a coupling step of {dt:g}",
            f"make it at most {1.0 / dt:.3g}",
        )
    if spacing is not None and case.only != "continuum":
        # hexagonal nearest neighbours: omega_max = sqrt(6 k / m) = 2.31 c_l / spacing
        frequency = 2.31 * c / spacing
        limit = MAX_MD_FREQUENCY_STEP / frequency
        rules.require(
            case.md_timestep() <= limit,
            "time.md_timestep",
            case.md_timestep(),
            f"is too long for the lattice, whose fastest vibration is about {frequency:.4g}",
            f"at most {limit:.2g}",
        )
    return rules.problems


def _step_key(case: Case, c: float) -> tuple[str, float, str]:
    """Key that sets the continuum's step, its value, and what would be stable."""
    h = case.finest_cell()
    if case.md is None:
        hint = (
            f"at most {MAX_CFL * h / c:.4g}; CFL {USUAL_CFL:g}, or auto, is {USUAL_CFL * h / c:.4g}"
        )
        return "time.step", case.step(), hint
    step = case.md_timestep()
    most, usual = (int(limit * h / c / step) for limit in (MAX_CFL, USUAL_CFL))
    hint = (
        f"at most {most} steps of {step:g}; CFL {USUAL_CFL:g} is {usual}"
        if most
        else f"no number of steps of {step:g} is stable; enlarge grid.cell"
    )
    return "time.md_steps", case.md_steps(), hint


def _check_files(case: Case, folder: Path, rules: Rules) -> None:
    for key, name in case.scripts():
        path = folder / name
        if not rules.require(
            path.is_file(), key, name, "no such file beside the case", f"looked for it in {folder}"
        ):
            continue
        rules.require(
            os.access(path, os.R_OK), key, name, "cannot be read", "check its permissions"
        )
