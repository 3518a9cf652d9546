"""Codes that can run a side of the coupling, found by their entry points.

A package that brings an MD code names it in the group ``gimpmd.md``; one that brings a continuum
code names it in ``gimpmd.continuum``::

    [project.entry-points."gimpmd.md"]
    mycode = "mypackage.atoms:MyAtoms"

The case then asks for it with ``md.backend: mycode`` or ``continuum.backend: mycode``.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError


def load_code(role: Role, name: str) -> Any:
    """Import the code that is installed under a name.

    Parameters
    ----------
    role : {"md", "continuum"}
        The side that the code runs.
    name : str
        The key ``md.backend`` or ``continuum.backend`` of the case.

    Returns
    -------
    object
        What the entry point names: a class that makes an ``Atoms`` or a ``ContinuumSolver``.

    Raises
    ------
    BackendError
        No installed package brings a code of this name, or its import fails.
    """
    group = f"gimpmd.{role}"
    installed = {entry.name: entry for entry in entry_points(group=group)}
    if name not in installed:
        names = ", ".join(sorted(installed)) or "none"
        raise BackendError(
            f"{role}.backend = {name!r}: no such code is installed (installed: {names}); choose "
            f"one of these, or install the package that has {name!r} in its entry points {group!r}"
        )
    try:
        return installed[name].load()
    except (ImportError, AttributeError) as error:
        place = installed[name].value
        raise BackendError(f"{role}.backend = {name!r}: cannot import {place}: {error}") from error
