"""The user's atoms: run the LAMMPS script of the case, then check the atoms it makes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.sums import extent
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.regions import md_region, md_regions
from gimpmd_schemas.case.derive.scripts import script_variables
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box

_INTEGRATORS = re.compile(
    r"^(nve|nvt|npt|nph|nvk|move|rigid|brownian|bocs|msst|qbmsst|press/langevin|rheo|pimd|mvv|"
    r"eos|pafi|numdiff|bond/react|sph|smd/integrate|drude/transform|tgnvt|tgnpt|gjf|gld|gle|ffl|"
    r"hmc|tfmc|meso/move)"
)
"""Beginnings of the fix styles that move atoms; gimpmd sets its own."""

SLACK_CELLS = 1e-6
"""How far atoms may lie outside their boxes, in cells."""


@dataclass(frozen=True)
class Script:
    """A script of the user, and what the atoms that it makes must fit.

    Attributes
    ----------
    path : str
        Relative to the working directory.
    variables : mapping
        LAMMPS variables for the script.
    units : str
        Unit style of the case.
    periodic : tuple of bool
        Axes along which the domain is periodic.
    region : Box
        Box around all atoms.
    regions : tuple of Box
        Boxes that hold the atoms.
    slack : float
        How far atoms may lie outside the boxes (length).
    """

    path: str
    variables: Mapping[str, float | str]
    units: str
    periodic: tuple[bool, ...]
    region: Box
    regions: tuple[Box, ...]
    slack: float

    @classmethod
    def of_plan(cls, plan: Plan) -> Script:
        """The script of a run."""
        md = plan.atoms
        return cls(
            path=md.input,
            variables=md.variables,
            units=plan.units,
            periodic=plan.domain.periodic,
            region=md.region,
            regions=md.regions,
            slack=SLACK_CELLS * plan.finest_cell,
        )

    @classmethod
    def of_case(cls, case: Case) -> Script:
        """The script of a case that may not be resolved yet."""
        return cls(
            path=case.atoms.input,
            variables=script_variables(case),
            units=case.units,
            periodic=case.domain.periodic,
            region=md_region(case),
            regions=md_regions(case),
            slack=SLACK_CELLS * finest_cell(case),
        )


def build(script: Script, comm: Any, log: Path, patches: tuple[int, ...] | None = None) -> Engine:
    """Run a LAMMPS script in the working directory and check the atoms that it makes.

    Parameters
    ----------
    script : Script
    comm : mpi4py communicator
    log : Path
        LAMMPS's log file.
    patches : tuple of int, optional
        Patches along each axis, one for each rank.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the atoms do not fit the case.
    """
    engine = Engine(comm, log)
    if patches is not None:
        counts = (*patches, 1)[:3]
        engine.commands([f"processors {' '.join(map(str, counts))}"])
    engine.script(script.path, script.variables)
    _check_style(script, engine)
    _check_box(script, engine)
    refuse_integrators(script.path, engine)
    return engine


def cutoff_of(script: Script, engine: Engine) -> float:
    """Range of the potential of the atoms (length); collective.

    Raises
    ------
    BackendError
        The script sets no potential.
    """
    cutoff = engine.pair_cutoff()
    if cutoff == 0.0:
        raise BackendError(f"{script.path}: sets no pair_style, so the atoms have no forces")
    return cutoff


def refuse_integrators(script: str, engine: Engine) -> None:
    """Raise `BackendError` if a fix of the script moves atoms."""
    for name, style in engine.fixes().items():
        if _INTEGRATORS.match(style) and not name.startswith("gimpmd_"):
            raise BackendError(
                f"{script}: fix {name} ({style}) integrates the motion of atoms, which gimpmd "
                "does itself; remove it (for a thermostat use fix langevin in md.after)"
            )


def rehearse(script: str, engine: Engine) -> None:
    """Read the script ``md.after`` once before the run, so that its errors come before the run.

    Groups with the names of gimpmd's exist, with other atoms than in the run: all are free.

    Parameters
    ----------
    script : str
        Relative to the working directory.
    engine : Engine
        Its atoms are of no use afterwards.

    Raises
    ------
    BackendError
        LAMMPS refuses a line, or a fix when it gets ready to run; or a fix integrates motion.
    """
    empty = [f"group gimpmd_{name} empty" for name in ("boundary", "surface")]
    engine.commands(["group gimpmd_free union all", *empty])
    engine.script(script, {})
    refuse_integrators(script, engine)
    try:
        engine.commands(["run 0 post no"])
    except BackendError as error:
        raise BackendError(f"{script}: {error}") from None


def _check_style(script: Script, engine: Engine) -> None:
    units = engine.lammps.extract_global("units")
    if units != script.units:
        raise BackendError(
            f"{script.path}: units {units}, but the case has units: {script.units}; make them equal"
        )
    dimension = engine.lammps.extract_setting("dimension")
    if dimension != len(script.region):
        raise BackendError(
            f"{script.path}: dimension {dimension}, but domain.box of the case has "
            f"{len(script.region)} axes; make them equal"
        )
    if engine.lammps.get_natoms() == 0:
        raise BackendError(f"{script.path}: makes no atoms; use create_atoms or read_data")


def _check_box(script: Script, engine: Engine) -> None:
    path, region = script.path, script.region
    low, high, *_, periodic, _ = engine.lammps.extract_box()
    for axis, name in enumerate("xyz"[: len(region)]):
        expected = script.periodic[axis]
        if bool(periodic[axis]) != expected:
            raise BackendError(
                f"{path}: the box is {'' if periodic[axis] else 'not '}periodic along {name}, but "
                f"the case's domain is {'' if expected else 'not '}; see the boundary command"
            )
        length = region[axis][1] - region[axis][0]
        if expected and abs(high[axis] - low[axis] - length) > 1e-6 * length:
            raise BackendError(
                f"{path}: the box is {high[axis] - low[axis]:.9g} long along the periodic axis "
                f"{name}, but the domain is {length:.9g}; make them equal"
            )
    x = engine.vectors("x")
    lowest, highest = extent(engine.comm, x)
    for axis, name in enumerate("xyz"[: len(region)]):
        start, end = region[axis]
        if lowest[axis] < start - script.slack or highest[axis] > end + script.slack:
            raise BackendError(
                f"{path}: atoms lie from {name} = {lowest[axis]:g} to {highest[axis]:g}, outside "
                f"the MD region [{start:g}, {end:g}]; use the variables xlo xhi ylo yhi that "
                "gimpmd sets"
            )
    if len(script.regions) > 1:
        _check_in_regions(script, x, engine.comm)


def _check_in_regions(script: Script, x: Floats, comm: Any) -> None:
    """Check that every atom lies in one of several MD regions; collective."""
    outside = np.ones(len(x), dtype=np.bool_)
    for box in script.regions:
        low, high = np.array(box).T
        outside &= ~((x >= low - script.slack) & (x <= high + script.slack)).all(axis=1)
    strays = np.concatenate(comm.allgather(x[outside]))
    if len(strays):
        place = ", ".join(f"{c:.6g}" for c in strays[0])
        raise BackendError(
            f"{script.path}: the atom at ({place}) lies in none of md.regions ({len(strays)} such "
            "atoms); use the variables xlo1 xhi1 ylo1 yhi1, xlo2 and so on that gimpmd sets"
        )
