"""The user's atoms: run the script of the case, then check what it made."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box

_INTEGRATORS = re.compile(
    r"^(nve|nvt|npt|nph|nvk|move|rigid|brownian|bocs|msst|qbmsst|press/langevin|rheo|pimd|mvv|"
    r"eos|pafi|numdiff|bond/react|sph|smd/integrate|drude/transform|tgnvt|tgnpt)"
)
"""Fix styles that move atoms, by their beginnings; gimpmd brings its own."""


def build(case: Case, comm: Any, log: Path) -> Engine:
    """Run the case's LAMMPS script in the working directory and check the atoms it makes.

    Raises
    ------
    BackendError
        LAMMPS refused the script, or the atoms do not fit the case.
    """
    engine = Engine(comm, log)
    counts = case.md_patches()
    if counts[0] * counts[1] == comm.size:  # a probe runs on one rank
        engine.commands([f"processors {counts[0]} {counts[1]} 1"])
    engine.script(case.atoms.input, script_variables(case))
    _check_style(case, engine)
    _check_box(case, engine)
    refuse_integrators(case.atoms.input, engine)
    return engine


def script_variables(case: Case) -> dict[str, float | str]:
    """What the scripts may use: the case's own variables, and the boxes of the atoms.

    ``xlo xhi ylo yhi`` are the box around all; of several regions there is that of each too,
    ``xlo1 xhi1 ylo1 yhi1`` and so on.
    """
    variables = dict(case.atoms.variables) | _corners(case.md_region(), "")
    if case.atoms.regions:
        for number, box in enumerate(case.atoms.regions, 1):
            # of a run of MD alone every region is the whole domain
            variables |= _corners(case.domain.box if case.only == "md" else box, str(number))
    return variables


def _corners(box: Box, number: str) -> dict[str, float]:
    (xlo, xhi), (ylo, yhi) = box
    return {
        f"xlo{number}": xlo,
        f"xhi{number}": xhi,
        f"ylo{number}": ylo,
        f"yhi{number}": yhi,
    }


def check_cutoff(case: Case, cutoff: float, pairwise: bool) -> None:
    """Boundary atoms must hide the region's rim from the free ones (paper section 4.1).

    Where forces depend on the surroundings of the neighbours too, as in EAM, the rim must lie two
    cutoffs away; the force scheme, which works with single bonds, cannot have them.

    Raises
    ------
    BackendError
        There are no pair interactions, they reach past the outer zone, or the scheme cannot have
        them.
    """
    if cutoff == 0.0:
        raise BackendError(f"{case.atoms.input}: sets no pair_style, so the atoms have no forces")
    if case.coupling.scheme == "force":
        if case.only is None and not pairwise:
            raise BackendError(
                f"{case.atoms.input}: the pair style is none of the sums over pairs that "
                "gimpmd knows, which coupling.scheme: force needs; use coupling.scheme: velocity"
            )
        return  # how deep the planes lie is checked where they are
    outer = case.zones().outer
    reach = cutoff if pairwise else 2.0 * cutoff
    if case.only is None and reach > outer * (1.0 + 1e-5):
        what = "pair cutoff" if pairwise else "reach of a potential that is no sum over pairs,"
        raise BackendError(
            f"{case.atoms.input}: the {what} {reach:g} is wider than the outer zone {outer:g}; "
            f"set coupling.zones.outer to at least {reach:g}"
        )


def refuse_integrators(script: str, engine: Engine) -> None:
    """Raise BackendError if a fix of the script moves atoms."""
    for name, style in engine.fixes().items():
        if _INTEGRATORS.match(style) and not name.startswith("gimpmd_"):
            raise BackendError(
                f"{script}: fix {name} ({style}) integrates the motion of atoms, which gimpmd "
                "does itself; remove it (a thermostat: fix langevin in md.after)"
            )


def _check_style(case: Case, engine: Engine) -> None:
    script = case.atoms.input
    units = engine.lammps.extract_global("units")
    if units != case.units:
        raise BackendError(
            f"{script}: units {units}, but the case says units: {case.units}; make them the same"
        )
    dimension = engine.lammps.extract_setting("dimension")
    if dimension != 2:
        raise BackendError(f"{script}: dimension {dimension}; the coupling is two-dimensional")
    if engine.lammps.get_natoms() == 0:
        raise BackendError(f"{script}: makes no atoms; use create_atoms or read_data")


def _check_box(case: Case, engine: Engine) -> None:
    script, region = case.atoms.input, case.md_region()
    low, high, *_, periodic, _ = engine.lammps.extract_box()
    for axis, name in enumerate("xy"):
        wanted = case.domain.periodic[axis]
        if bool(periodic[axis]) != wanted:
            raise BackendError(
                f"{script}: the box is {'' if periodic[axis] else 'not '}periodic along {name}, "
                f"the case's domain is {'' if wanted else 'not '}; see the boundary command"
            )
        length = region[axis][1] - region[axis][0]
        if wanted and abs(high[axis] - low[axis] - length) > 1e-6 * length:
            raise BackendError(
                f"{script}: the box is {high[axis] - low[axis]:.9g} long along the periodic axis "
                f"{name}, the domain {length:.9g}; make them the same"
            )
    x, eps = engine.pairs("x"), 1e-6 * case.finest_cell()
    bounds = np.array([[np.inf, np.inf], [-np.inf, -np.inf]])
    if len(x):
        bounds = np.array([x.min(axis=0), x.max(axis=0)])
    lowest, highest = extent(engine.comm, bounds)
    for axis, name in enumerate("xy"):
        if lowest[axis] < region[axis][0] - eps or highest[axis] > region[axis][1] + eps:
            raise BackendError(
                f"{script}: atoms lie from {name} = {lowest[axis]:g} to {highest[axis]:g}, outside "
                f"the MD region [{region[axis][0]:g}, {region[axis][1]:g}]; use the variables "
                "xlo xhi ylo yhi that gimpmd sets"
            )
    if len(case.md_regions()) > 1:
        _check_in_regions(case, x, eps, engine.comm)


def _check_in_regions(case: Case, x: Floats, eps: float, comm: Any) -> None:
    """Every atom lies in one of several MD regions; collective."""
    outside = np.ones(len(x), dtype=np.bool_)
    for box in case.md_regions():
        low, high = np.array(box).T
        outside &= ~((x >= low - eps) & (x <= high + eps)).all(axis=1)
    strays = np.concatenate(comm.allgather(x[outside]))
    if len(strays):
        raise BackendError(
            f"{case.atoms.input}: the atom at ({strays[0, 0]:.6g}, {strays[0, 1]:.6g}) lies in "
            f"none of md.regions ({len(strays)} such); use the variables xlo1 xhi1 ylo1 yhi1, "
            "xlo2 and so on that gimpmd sets"
        )


def extent(comm: Any, bounds: np.ndarray[Any, Any]) -> tuple[Any, Any]:
    """Least and greatest of the ranks' lower (row 0) and upper (row 1) bounds; collective."""
    ranks = np.array(comm.allgather(bounds))
    return ranks[:, 0].min(axis=0), ranks[:, 1].max(axis=0)
