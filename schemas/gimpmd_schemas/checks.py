"""What a case means: geometry, stability, files. All problems are found before any run."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec

from gimpmd_schemas.case import FACES, Case, Elastic
from gimpmd_schemas.errors import Problem

MAX_CFL = 1.0
"""Largest accepted ``c dt / h``: the critical number of USAVG and MUSL is 1.73, 0.4 is usual."""

MAX_CELLS = 10**9
"""Largest accepted number of cells: beyond it the nodes alone fill any machine's memory."""

HUGE = 1e100
"""Numbers above it, or closer to zero than its inverse, are slips; products of them overflow."""

MAX_MD_FREQUENCY_STEP = 0.5
"""Largest accepted ``omega_max dt`` of the atoms; velocity Verlet breaks at 2."""


class _Check:
    """Collects problems; ``require`` reads as a rule."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def require(self, holds: bool, key: str, value: object, message: str, hint: str = "") -> bool:
        """Note a problem unless the rule holds; says whether it does."""
        if not holds:
            self.problems.append(Problem(key, value, message, hint))
        return holds


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
    check = _Check()
    _check_numbers(case, check)
    if not check.problems:  # geometry on senseless numbers would only add noise
        _check_geometry(case, check)
        _check_zones(case, check)
        _check_faces(case, check)
        _check_patches(case, check)
        _check_cracks(case, check)
        _check_packets(case, check)
    if isinstance(case.continuum.material, Elastic) and not check.problems:
        check.problems += check_stability(case)
    if folder is not None:
        _check_files(case, folder, check)
    return check.problems


def _check_numbers(case: Case, check: _Check) -> None:
    for key, value in _numbers(msgspec.to_builtins(case)):
        check.require(
            value == 0.0 or 1.0 / HUGE <= abs(value) <= HUGE,
            key,
            value,
            f"must be a number between {1 / HUGE:g} and {HUGE:g} in size",
        )
    positive: list[tuple[str, float]] = [
        ("grid.cell", case.grid.cell),
        ("time.end", case.time.end),
        ("time.md_timestep", case.time.md_timestep),
        ("output.interval", case.output.interval),
        ("grid.points_per_cell", case.grid.points_per_cell),
        ("md.ranks", case.md.ranks),
        ("continuum.ranks", case.continuum.ranks),
    ]
    if case.time.md_steps != "auto":
        positive.append(("time.md_steps", case.time.md_steps))
    if case.continuum.threads != "auto":
        positive.append(("continuum.threads", case.continuum.threads))
    if case.md.cutoff is not None:
        positive.append(("md.cutoff", case.md.cutoff))
    if isinstance(case.continuum.material, Elastic):
        material = case.continuum.material
        positive.append(("continuum.material.density", material.density))
        positive.append(("continuum.material.shear", material.shear))
        check.require(
            material.lame + material.shear > 0.0,
            "continuum.material.lame",
            material.lame,
            f"must exceed {-material.shear:g}, minus the shear modulus, for a stiff material",
        )
    for key, number in positive:
        check.require(number > 0, key, number, "must be positive")
    for name in ("outer", "inner", "filter"):
        width = getattr(case.coupling.zones, name)
        key = f"coupling.zones.{name}"
        check.require(width is None or width > 0, key, width, "must be positive")
    width = case.coupling.zones.incommunicado
    check.require(
        width is None or width >= 0,
        "coupling.zones.incommunicado",
        width,
        "must not be negative",
    )
    check.require(
        case.coupling.filter_rate is None or case.coupling.filter_rate >= 0,
        "coupling.filter_rate",
        case.coupling.filter_rate,
        "must not be negative",
    )
    xpic = case.continuum.xpic
    check.require(xpic.order >= 1, "continuum.xpic.order", xpic.order, "must be at least 1")
    check.require(xpic.every >= 0, "continuum.xpic.every", xpic.every, "must not be negative")
    check.require(
        case.continuum.ranks <= 1,
        "continuum.ranks",
        case.continuum.ranks,
        "the GIMP service runs on one rank",
        "give it more cores with continuum.threads",
    )
    check.require(
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


def _check_geometry(case: Case, check: _Check) -> None:
    h = case.grid.cell
    for axis, name in enumerate("xy"):
        low, high = case.domain.box[axis]
        if not check.require(
            high > low,
            "domain.box",
            case.domain.box,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        ):
            continue
        cells = (high - low) / h
        check.require(
            abs(cells - round(cells)) < 1e-6 and round(cells) >= 1,
            "grid.cell",
            h,
            f"does not divide the domain along {name}: {high - low:g} / {h:g} = {cells:.6g} cells",
            f"a cell of {(high - low) / max(1, round(cells)):.9g} would",
        )
        rlow, rhigh = case.md.region[axis]
        if not check.require(
            rhigh > rlow,
            "md.region",
            case.md.region,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        ):
            continue
        eps = 1e-9 * h
        inside = rlow >= low - eps and rhigh <= high + eps
        check.require(
            inside,
            "md.region",
            case.md.region,
            f"leaves the domain along {name}: [{low:g}, {high:g}]",
            "move the region inside the domain",
        )
        if case.domain.periodic[axis] and inside:
            spans = abs(rlow - low) < eps and abs(rhigh - high) < eps
            check.require(
                spans,
                "md.region",
                case.md.region,
                f"must span the whole domain along the periodic axis {name}",
                f"set it to [{low:g}, {high:g}] along {name}",
            )
    (x0, x1), (y0, y1) = case.domain.box
    cells = (x1 - x0) / h * ((y1 - y0) / h)
    check.require(
        cells <= MAX_CELLS,
        "grid.cell",
        h,
        f"makes {cells:.3g} cells, more than {MAX_CELLS:g}",
        "make the cell larger or the domain smaller",
    )
    check.require(
        case.grid.points_per_cell in (1, 2, 3, 4),
        "grid.points_per_cell",
        case.grid.points_per_cell,
        "must be 1, 2, 3 or 4",
    )
    check.require(
        case.time.end >= case.time.md_timestep,
        "time.end",
        case.time.end,
        "comes before the first MD step",
        f"at least {case.time.md_timestep:g}, one time.md_timestep",
    )
    check.require(
        case.continuum.interpolation != "cpgimp" or case.grid.points_per_cell > 1,
        "continuum.interpolation",
        case.continuum.interpolation,
        "needs room for the points to stretch within a cell",
        "set grid.points_per_cell to 2 or more, or take ugimp",
    )


def _check_zones(case: Case, check: _Check) -> None:
    if case.only is not None or check.problems:
        return
    zones = case.zones()
    key = "coupling.zones"
    if not check.require(
        any(any(pair) for pair in zones.interfaces),
        "md.region",
        case.md.region,
        "fills the domain, so there is nothing to couple",
        "run it with --only md, or make the region smaller",
    ):
        return
    if case.md.cutoff is not None:
        check.require(
            zones.outer >= case.md.cutoff * (1.0 - 1e-5),
            f"{key}.outer",
            zones.outer,
            f"is narrower than the potential's cutoff {case.md.cutoff:g}",
            f"make it at least {case.md.cutoff:g} (paper section 4.1)",
        )
    check.require(
        case.continuum.integrator != "usavg",
        "continuum.integrator",
        case.continuum.integrator,
        "does not fit the velocity scheme: its velocities stand at whole steps",
        "write auto or musl",
    )
    layer = case.grid.cell / case.grid.points_per_cell
    check.require(
        zones.inner >= 4.0 * layer * (1 - 1e-9),
        f"{key}.inner",
        zones.inner,
        f"is narrower than four layers of points ({4 * layer:g})",
        f"six layers ({6 * layer:g}) are a sound choice",
    )
    for axis, name in enumerate("xy"):
        count = sum(zones.interfaces[axis])
        low, high = zones.region[axis]
        need = count * zones.innermost
        check.require(
            count == 0 or high - low > need,
            f"{key}",
            f"outer {zones.outer:g}, incommunicado {zones.incommunicado:g}, inner {zones.inner:g}",
            f"do not fit the MD region along {name}: they need {need:g}, it is {high - low:g} wide",
            "narrow the zones or widen md.region",
        )
        for side in range(2):
            gap = abs(zones.region[axis][side] - case.domain.box[axis][side])
            need = max(zones.filter, 2.0 * case.grid.cell)
            check.require(
                not zones.interfaces[axis][side] or gap >= need * (1 - 1e-9),
                "md.region",
                case.md.region,
                f"comes within {gap:g} of the domain's {FACES[2 * axis + side]} face; the "
                f"continuum between needs {need:g}",
                "end the region on the face, or move it away",
            )


def _check_faces(case: Case, check: _Check) -> None:
    for axis in range(2):
        for side in range(2):
            name = FACES[2 * axis + side]
            key, face = f"boundary.{name}", case.boundary.face(axis, side)
            check.require(face.ramp >= 0, f"{key}.ramp", face.ramp, "must not be negative")
            loaded = face.condition in ("traction", "velocity")
            given = [v for v in face.value if v is not None]
            check.require(
                not loaded or bool(given),
                f"{key}.value",
                None,
                f"a {face.condition} needs a value",
                "write two components, for example [0, 0.3]",
            )
            check.require(
                loaded or not given,
                f"{key}.value",
                list(face.value),
                f"a {face.condition} face takes no value",
                "leave it out, or set condition: traction or velocity",
            )
            check.require(
                not (case.domain.periodic[axis] and face.condition != "free"),
                f"{key}.condition",
                face.condition,
                "lies across a periodic axis, where there is no face",
                "leave it out",
            )


def _check_patches(case: Case, check: _Check) -> None:
    (x0, x1), (y0, y1) = case.md_region()
    cells = (x1 - x0) * (y1 - y0) / case.grid.cell**2
    check.require(
        case.md.ranks <= max(1.0, cells),
        "md.ranks",
        case.md.ranks,
        f"are more than the {cells:.4g} cells of the MD region",
        "a rank wants hundreds of atoms; use fewer",
    )
    if case.md.patches == "auto":
        return
    px, py = case.md.patches
    check.require(
        px >= 1 and py >= 1 and px * py == case.md.ranks,
        "md.patches",
        list(case.md.patches),
        f"do not tile the region over md.ranks = {case.md.ranks}: {px} x {py} = {px * py}",
        "let the product be the number of ranks, or write auto",
    )


def _check_cracks(case: Case, check: _Check) -> None:
    check.require(
        not (case.continuum.cracks and any(case.domain.periodic)),
        "continuum.cracks",
        len(case.continuum.cracks),
        "cracks of the continuum and periodic axes do not go together yet",
        "make the domain free along both axes, or leave the cracks out",
    )
    for index, crack in enumerate(case.continuum.cracks):
        key = f"continuum.cracks[{index}]"
        ends = [list(crack.start), list(crack.end)]
        check.require(
            crack.start != crack.end, key, ends, "has no length", "let from and to differ"
        )
        for x, y in (crack.start, crack.end):
            (x0, x1), (y0, y1) = case.domain.box
            check.require(
                x0 <= x <= x1 and y0 <= y <= y1,
                key,
                ends,
                f"its end ({x:g}, {y:g}) leaves the domain",
                f"the domain is [{x0:g}, {x1:g}] x [{y0:g}, {y1:g}]",
            )
        zones = case.zones()
        if case.only is None:
            import numpy as np

            depth = zones.depth(np.array(ends, dtype=float))
            check.require(
                bool((depth > zones.innermost).all()),
                key,
                ends,
                "reaches the zones or the continuum of the coupled run",
                "cracks belong inside the MD region, deeper than the inner zone",
            )


def _check_packets(case: Case, check: _Check) -> None:
    for index, packet in enumerate(case.initial.packets):
        key = f"initial.packets[{index}]"
        check.require(
            packet.wavelength > 0, f"{key}.wavelength", packet.wavelength, "must be positive"
        )
        check.require(packet.cycles > 0, f"{key}.cycles", packet.cycles, "must be positive")
        low, high = case.domain.box[packet.axis]
        check.require(
            low <= packet.center <= high,
            f"{key}.center",
            packet.center,
            "leaves the domain",
            f"the domain is [{low:g}, {high:g}] along {'xy'[packet.axis]}",
        )


def check_stability(case: Case, spacing: float | None = None) -> list[Problem]:
    """Time steps against the CFL condition and the fastest vibration of the lattice.

    Parameters
    ----------
    spacing : float, optional
        Distance of neighbouring atoms, or ``sqrt(area per atom)``, which is 7 % less in a hexagonal
        crystal and so on the safe side; without it the MD time step is not checked.
    """
    check = _Check()
    dt, h, c = case.step(), case.grid.cell, case.wave_speed("P")
    if case.only != "md":
        cfl = c * dt / h
        most, usual = (int(limit * h / c / case.time.md_timestep) for limit in (MAX_CFL, 0.4))
        check.require(
            cfl <= MAX_CFL,
            "time.md_steps",
            case.md_steps(),
            f"makes the continuum step {dt:g} unstable: c dt / h = {cfl:.3g} > {MAX_CFL:g}",
            f"at most {most} steps of {case.time.md_timestep:g}; CFL 0.4 is {usual}"
            if most
            else f"no number of steps of {case.time.md_timestep:g} is stable; enlarge grid.cell",
        )
    if spacing is not None and case.only != "continuum":
        # hexagonal nearest neighbours: omega_max = sqrt(6 k / m) = 2.31 c_l / spacing
        frequency = 2.31 * c / spacing
        limit = MAX_MD_FREQUENCY_STEP / frequency
        check.require(
            case.time.md_timestep <= limit,
            "time.md_timestep",
            case.time.md_timestep,
            f"is too long for the lattice, whose fastest vibration is about {frequency:.4g}",
            f"at most {limit:.2g}",
        )
    return check.problems


def _check_files(case: Case, folder: Path, check: _Check) -> None:
    for key, name in case.scripts():
        path = folder / name
        if not check.require(
            path.is_file(), key, name, "no such file beside the case", f"looked for it in {folder}"
        ):
            continue
        check.require(
            os.access(path, os.R_OK), key, name, "cannot be read", "check its permissions"
        )
