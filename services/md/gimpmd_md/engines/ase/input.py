"""The input of the user: a YAML file that names a calculator and the atoms."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from gimpmd_schemas.errors import BackendError


class Crystal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A crystal with a rectangular cell, which fills the MD regions.

    Attributes
    ----------
    cell : edges of the cell (length). A third edge in a body of two dimensions is the period of
        the crystal normal to the plane.
    sites : positions of its atoms, as fractions of the edges.
    species : chemical symbol of each of them; ``X`` for an atom without an element.
    origin : a corner of the cell (length); empty: the origin.
    """

    cell: tuple[float, ...]
    sites: tuple[tuple[float, ...], ...]
    species: tuple[str, ...]
    origin: tuple[float, ...] = ()


class Input(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The calculator and the atoms.

    Attributes
    ----------
    calculator : ``module:name`` of a class or function that returns a calculator. The module is
        installed, or a Python file beside the case.
    arguments : keyword arguments for it.
    crystal, structure : the atoms: a crystal that fills the MD regions, or a file with all atoms,
        in any format that ``ase.io`` reads.
    masses : mass of each species (mass units), in place of those of the elements.
    """

    calculator: str
    arguments: dict[str, Any] = {}
    crystal: Crystal | None = None
    structure: str | None = None
    masses: dict[str, float] = {}


def read_input(name: str, dim: int) -> Input:
    """Read the input in the working directory.

    Parameters
    ----------
    name : str
        The key ``md.input`` of the case.
    dim : int
        Number of dimensions of the body.

    Raises
    ------
    BackendError
        The file is missing, or it is not an input for ASE.
    """
    try:
        found = msgspec.yaml.decode(Path(name).read_bytes(), type=Input)
    except (OSError, msgspec.DecodeError) as error:  # ValidationError too
        raise BackendError(
            f"{name}: is not an input for md.backend: ase: {error}; it needs the keys calculator "
            "and crystal or structure (docs/case.md, ASE)"
        ) from error
    if (found.crystal is None) == (found.structure is None):
        raise BackendError(f"{name}: give either crystal or structure, which make the atoms")
    if found.crystal is not None:
        _check_crystal(name, found.crystal, dim)
    for species, mass in found.masses.items():
        if not mass > 0.0:
            raise BackendError(f"{name}: masses.{species} = {mass:g} must be positive")
    return found


def _check_crystal(name: str, crystal: Crystal, dim: int) -> None:
    edges = len(crystal.cell)
    if edges not in (dim, 3) or not all(edge > 0.0 for edge in crystal.cell):
        raise BackendError(
            f"{name}: crystal.cell = {list(crystal.cell)} must be {dim} positive lengths"
            + (", or three for a crystal that repeats normal to the plane" if dim == 2 else "")
        )
    if not crystal.sites or any(len(site) != edges for site in crystal.sites):
        raise BackendError(
            f"{name}: crystal.sites must be positions of {edges} fractions each, as many as "
            "crystal.cell has edges"
        )
    if len(crystal.species) != len(crystal.sites):
        raise BackendError(
            f"{name}: crystal.species has {len(crystal.species)} entries, but crystal.sites has "
            f"{len(crystal.sites)}; write one symbol for each site"
        )
    if len(crystal.origin) not in (0, edges):
        raise BackendError(
            f"{name}: crystal.origin = {list(crystal.origin)} must have {edges} entries"
        )


def calculator_maker(name: str, given: Input) -> Callable[[], Any]:
    """What makes a new calculator at every call.

    Parameters
    ----------
    name : str
        The file of the input, for messages.
    given : Input

    Raises
    ------
    BackendError
        The calculator cannot be imported, or it refuses its arguments.
    """
    module, colon, attribute = given.calculator.partition(":")
    if not (module and colon and attribute):
        raise BackendError(
            f"{name}: calculator = {given.calculator!r} must be module:name, such as "
            "ase.calculators.emt:EMT"
        )
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # modules beside the case
    try:
        make = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise BackendError(
            f"{name}: calculator = {given.calculator!r}: {error}; install the module, or put it "
            "beside the case and name its file in md.files"
        ) from error

    def maker() -> Any:
        try:
            return make(**given.arguments)
        except Exception as error:  # of a code that is not ours
            raise BackendError(
                f"{name}: {given.calculator} with the arguments {given.arguments}: {error}"
            ) from error

    return maker
