"""The lowest mode of atoms and nodes in the sites scheme, looked at before a run."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec

from gimpmd_deploy.launch.asking import ask_stiffness
from gimpmd_deploy.launch.asking_continuum import ask_lowest_mode, knows_sites
from gimpmd_deploy.launch.helper_command import folder_of_case
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import LowestMode
from gimpmd_schemas.wire.stiffness import MOST

FILE = "stiffness.npz"
"""With which the MD service hands the stiffness of its atoms over."""


class Modes(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of the modes.

    Attributes
    ----------
    freedoms : of free atoms and nodes around the planes; of the atoms alone if these are too many.
    most : freedoms up to which modes are looked at.
    lowest : stiffness of the lowest mode that is no rigid motion, over that of the stiffest; null
        if there are too many freedoms.
    seconds : that it took.
    """

    freedoms: int
    most: int
    lowest: float | None
    seconds: float


def look_at_modes(case: Case, path: Path) -> Modes | None:
    """Find the lowest mode of a case whose region is small enough.

    Parameters
    ----------
    case : Case
        With what LAMMPS has measured, if it was asked.
    path : Path
        The case file, for its scripts and for messages.

    Returns
    -------
    Modes or None
        None without the sites scheme, or if only LAMMPS knows where the planes are.

    Raises
    ------
    BackendError
        A mode has negative stiffness: the set-up is not stable.
    PeerLostError
        A service crashed, or gave no answer in time.
    """
    if not knows_sites(case):
        return None
    start, most = time.perf_counter(), MOST[case.dim]
    with folder_of_case(case, path) as folder:
        of_atoms = ask_stiffness(case, path, folder, FILE).freedoms
        found = LowestMode(freedoms=of_atoms, stiffness=None)
        if of_atoms <= most:
            found = ask_lowest_mode(path, folder, FILE)
    seconds = time.perf_counter() - start
    return Modes(
        freedoms=found.freedoms, most=most, lowest=found.stiffness, seconds=round(seconds, 1)
    )


def said_of(modes: Modes) -> str:
    """One line."""
    if modes.lowest is None:
        return (
            f"not looked at: {modes.freedoms:,} freedoms of atoms and nodes, and at most "
            f"{modes.most:,} are"
        )
    return (
        f"all stable, the lowest has {modes.lowest:.1e} of the largest stiffness "
        f"({modes.freedoms:,} freedoms, {modes.seconds:.1f} s)"
    )
