"""What the user should know about the script of the atoms, as sentences for the report."""

from __future__ import annotations

from gimpmd_md.engines.lammps.fix_work import OWN, not_covered
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.truncation import largest_jump, sentence
from gimpmd_schemas.mechanics.units import UNITS


def notes_on(path: str, units: str, engine: Engine, cutoff: float) -> tuple[str, ...]:
    """Jumps of the potential, and fixes that the energy balance does not cover; collective.

    Parameters
    ----------
    path : str
        The script that has made the atoms of the engine.
    units : str
        Unit style.
    engine : Engine
    cutoff : float
        Range of the potential (length).
    """
    jump = largest_jump(engine, cutoff)
    fixes = {n: style for n, style in engine.fixes().items() if not n.startswith(OWN)}
    jumps = [sentence(jump, path, UNITS[units].energy)] if jump else []
    return (*jumps, *not_covered(path, fixes, late=False))
