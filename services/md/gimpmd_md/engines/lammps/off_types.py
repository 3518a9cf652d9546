"""The user's atoms with twice as many types, those that are added for sites that are off.

LAMMPS fixes the number of types when it makes a box. So once the script of the user has made the
atoms, they go to a file, LAMMPS forgets everything, reads them back with more types, and gets a
potential whose sites can be switched off.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

from gimpmd_md.engines.lammps.library import Engine, check_written, text_of
from gimpmd_md.engines.lammps.site_off.commands import Potential, commands_in, potential_in
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.errors import BackendError, GimpmdError

KEPT = ("newton", "processors", "atom_style", "atom_modify", "comm_style", "comm_modify")
"""Commands of the script that are given again before the atoms are read."""

KEPT_LATER = ("neighbor", "neigh_modify")
"""Commands that are given again after the potential."""

SAME_ENERGY = 1e-9
"""Largest accepted relative change of the energy."""

T = TypeVar("T")


class OffTypes(NamedTuple):
    """What a script's atoms have become.

    Attributes
    ----------
    types : int
        Number of types n of the script. Type ``t + n`` is that of atoms of type t whose sites are
        off.
    potential : Potential
        For 2 n types.
    """

    types: int
    potential: Potential


def double_types(script: str, engine: Engine, folder: Path) -> OffTypes:
    """Give every type of atoms a second one, whose sites are off; collective.

    All sites are on at first. Groups, regions and computes of the script are gone afterwards.

    Parameters
    ----------
    script : str
        Script that has made the atoms, for messages.
    folder : Path
        Where potential files are written.

    Raises
    ------
    BackendError
        The script defines fixes or bonds, or sites of its potential cannot be switched off.
    """
    lammps, comm = engine.lammps, engine.comm
    types = int(lammps.extract_setting("ntypes"))
    _check(script, engine)
    before = _energy(engine)
    lammps.flush_buffers()
    commands, potential = _first_rank(
        engine, lambda: _read(script, text_of(engine.log), types, folder)
    )
    dim, units = lammps.extract_setting("dimension"), lammps.extract_global("units")
    periodic = lammps.extract_box()[5]
    masses = [lammps.extract_atom("mass")[t] for t in range(1, types + 1)]
    file = folder / "doubled.data"
    engine.commands([f"write_data {file} nocoeff"])
    _first_rank(engine, lambda: check_written(file))
    engine.commands(["clear"])
    engine.forget()
    engine.commands(
        [
            f"units {units}",
            f"dimension {dim}",
            f"boundary {' '.join('p' if axis else 's' for axis in periodic)}",
            *(line for line in commands if line.split()[0] in KEPT),
            f"read_data {file} extra/atom/types {types}",
            *(f"mass {t} {masses[(t - 1) % types]!r}" for t in range(1, 2 * types + 1)),
            *potential.commands(),
            *(f"mass {t} {masses[(t - 1) % types]!r}" for t in range(1, 2 * types + 1)),
            *(line for line in commands if line.split()[0] in KEPT_LATER),
        ]
    )
    if comm.rank == 0:
        file.unlink()
    after = _energy(engine)
    if abs(after - before) > SAME_ENERGY * abs(before):
        raise BackendError(
            f"{script}: with the potential whose sites can be switched off the energy of the atoms "
            f"is {after:.10g} instead of {before:.10g}; use coupling.scheme: velocity"
        )
    return OffTypes(types, potential)


def _read(script: str, log: str, types: int, folder: Path) -> tuple[list[str], Potential]:
    """Commands to repeat, and the potential with sites that are off."""
    found: dict[str, str] = {}
    limits = []
    for line in commands_in(log):
        command = line.split()[0]
        if command == "neigh_modify":  # each of them adds to the others
            limits.append(line)
        elif command in KEPT + KEPT_LATER:
            found[command] = line
    try:
        return [*found.values(), *limits], with_off_sites(potential_in(log), types, folder)
    except BackendError as error:
        raise BackendError(f"{script}: {error}") from None


def _check(script: str, engine: Engine) -> None:
    """Refuse what would be lost, or has no site."""
    fixes = {n: style for n, style in engine.fixes().items() if not n.startswith("gimpmd_")}
    for name, style in fixes.items():
        raise BackendError(
            f"{script}: fix {name} ({style}): coupling.scheme: sites makes the atoms once more, "
            "without the fixes of this script; write them in the script md.after"
        )
    if engine.lammps.extract_global("nbonds"):
        raise BackendError(
            f"{script}: the atoms have bonds, whose energies belong to no site; use "
            "coupling.scheme: velocity"
        )


def _energy(engine: Engine) -> float:
    engine.commands(["thermo_modify norm no", "run 0 post no"])
    return engine.thermo("pe")


def _first_rank(engine: Engine, work: Callable[[], T]) -> T:
    """Result of work on the first rank; an error there is raised on all."""
    found: T | None = None
    error: GimpmdError | None = None
    if engine.comm.rank == 0:
        try:
            found = work()
        except GimpmdError as caught:
            error = caught
    found, error = engine.comm.bcast((found, error))
    if error is not None:
        raise error
    return found
