"""Implementations found by name: codes by entry points, laws and conditions by their modules.

A package that brings an MD code names it in the group ``gimpmd.md``; one that brings a continuum
code names it in ``gimpmd.continuum``::

    [project.entry-points."gimpmd.md"]
    mycode = "mypackage.atoms:MyAtoms"

The case then asks for it with ``md.backend: mycode`` or ``continuum.backend: mycode``. A code may
say what it can do in a class attribute ``abilities``; ``gimpmd backends`` shows it.

Laws and conditions are modules of a package, and each of them says in a mapping what it makes.
`collect` merges these mappings, so a new law or condition is a new module and no list changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from typing import Any

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError, Problem


@dataclass(frozen=True)
class Abilities:
    """What a code can do.

    Attributes
    ----------
    dimensions : tuple of int
    materials : str
        Potentials of an MD code, or laws of a continuum code.
    schemes : tuple of str
        Coupling schemes; see ``coupling.scheme``.
    ranks : int or None
        Most MPI ranks; None: any number.
    checkpoint : bool
        Whether a run can continue from a checkpoint.
    """

    dimensions: tuple[int, ...]
    materials: str
    schemes: tuple[str, ...]
    ranks: int | None
    checkpoint: bool


@dataclass(frozen=True)
class InstalledCode:
    """A code that some installed package brings.

    Attributes
    ----------
    role : {"md", "continuum"}
    name : str
        The key ``md.backend`` or ``continuum.backend`` of the case.
    version : str
        Name and version of the code; empty if it cannot be imported.
    abilities : Abilities or None
        None: not stated.
    problem : str
        Why the code cannot be used; empty if it can.
    """

    role: Role
    name: str
    version: str = ""
    abilities: Abilities | None = None
    problem: str = ""


def installed_codes(role: Role) -> list[InstalledCode]:
    """Import all codes that can run a side, and ask each of them what it can do."""
    return [_ask(role, name) for name in sorted(_installed(role))]


def _ask(role: Role, name: str) -> InstalledCode:
    try:
        code = load_code(role, name)
    except BackendError as error:
        return InstalledCode(role, name, problem=str(error))
    abilities = getattr(code, "abilities", None)
    return InstalledCode(role, name, code.version(), abilities)


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
    if unknown := check_code(role, name):
        raise BackendError(str(unknown))
    code = _installed(role)[name]
    try:
        return code.load()
    except (ImportError, AttributeError) as error:
        missing = getattr(error, "name", None) if isinstance(error, ModuleNotFoundError) else None
        hint = f"; install it: pip install {missing.partition('.')[0]}" if missing else ""
        raise BackendError(
            f"{role}.backend = {name!r}: cannot import {code.value}: {error}{hint}"
        ) from error


def check_code(role: Role, name: str) -> Problem | None:
    """Return the problem if no installed package brings a code of this name.

    Nothing is imported.
    """
    installed = _installed(role)
    if name in installed:
        return None
    names = ", ".join(sorted(installed)) or "none"
    return Problem(
        f"{role}.backend",
        name,
        f"no such code is installed (installed: {names})",
        f"choose one of these, or install the package that has {name!r} in its entry points "
        f"{_group(role)!r}",
    )


def _group(role: Role) -> str:
    return f"gimpmd.{role}"


def _installed(role: Role) -> dict[str, EntryPoint]:
    """Entry points of the codes that can run a side, by name."""
    return {entry.name: entry for entry in entry_points(group=_group(role))}


def collect(package: str, attribute: str) -> dict[Any, Any]:
    """Merge the mappings that the modules of a package define under a name.

    Parameters
    ----------
    package : str
        Name of the package. Its modules are imported in alphabetical order.
    attribute : str
        Name of the mapping. Modules without it are left out.

    Raises
    ------
    ValueError
        Two modules have an entry for the same key.
    """
    found: dict[Any, Any] = {}
    origin: dict[Any, str] = {}
    for name in sorted(module.name for module in iter_modules(import_module(package).__path__)):
        entries = getattr(import_module(f"{package}.{name}"), attribute, {})
        for key in entries:
            if key in found:
                raise ValueError(
                    f"{package}: the modules {origin[key]!r} and {name!r} both have an entry for "
                    f"{key!r} in {attribute}; remove one of them"
                )
            origin[key] = name
        found |= entries
    return found
