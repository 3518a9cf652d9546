"""Answers of the helper commands of the services: one JSON object on standard output."""

from __future__ import annotations

import msgspec

from gimpmd_schemas.case.form import Crystal, Planes, Sites
from gimpmd_schemas.case.materials import Material


class Probe(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd-md probe``: what only the MD code knows about a case.

    Everything about the atoms is left out for a run of the continuum only.

    Attributes
    ----------
    atoms : number of atoms that the script makes.
    mass : their total mass.
    cutoff : range of the potential (length).
    spacing : distance of neighbouring atoms (length), the d-th root of the volume per atom.
    material : density and moduli measured on the periodic cell, if the case asks for them.
    crystal, planes : crystal and interface, if the case is coupled by the force scheme.
    planes, sites : planes, and what acts at them, if it is coupled by the sites scheme.
    notes : what the user should know about the atoms, one sentence each.
    """

    atoms: int = 0
    mass: float | None = None
    cutoff: float | None = None
    spacing: float | None = None
    material: Material | None = None
    crystal: Crystal | None = None
    planes: Planes | tuple[Planes, ...] | None = None
    sites: Sites | None = None
    notes: tuple[str, ...] = ()


class CorrectionSize(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd_gimp.correction_size``: what the correction of the sites scheme takes.

    Attributes
    ----------
    equations : number of its equations.
    memory : bytes that each rank of the continuum needs while it solves them.
    """

    equations: int
    memory: int


class FreeAtoms(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd-md stiffness``, which also writes a file.

    Attributes
    ----------
    freedoms : of the free atoms. If there are more than ``gimpmd_schemas.wire.stiffness.MOST``,
        there is no file.
    """

    freedoms: int


class LowestMode(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd_gimp.lowest_mode``.

    Attributes
    ----------
    freedoms : of the free atoms and of the nodes around the planes.
    stiffness : of the lowest mode that is no rigid motion, over that of the stiffest; None if there
        are too many freedoms to look at.
    """

    freedoms: int
    stiffness: float | None


class Repeat(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd-md cell``: how the periodic cell of a crystal repeats.

    Attributes
    ----------
    low, size : lower corner and edges of the cell (length), one number for each axis.
    period : shortest translation of the crystal along each axis (length); it divides ``size``.
    """

    low: tuple[float, ...]
    size: tuple[float, ...]
    period: tuple[float, ...]


class Surfaces(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd-md surfaces``: surface energies of a crystal.

    Attributes
    ----------
    unrelaxed, relaxed : energy gamma of a surface normal to each axis (pressure times length), as
        cut, and after its atoms have moved to rest.
    """

    unrelaxed: tuple[float, ...]
    relaxed: tuple[float, ...]


class StrainSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of ``gimpmd-md strain``: what was computed.

    Attributes
    ----------
    method : the strain's definition, as in the settings.
    columns : names of the new columns.
    atoms, frames : number of atoms in each frame, and of frames written.
    dimension : 2 or 3.
    reference : time step of the undeformed state.
    distance : median distance of nearest neighbours in the undeformed state (length).
    cell : edge of the grid's cells (length), or None for a method without a grid.
    cutoff : range of neighbours (length), or None for a method without neighbours.
    undefined : atoms of the last frame whose strain is undefined, since they have too few
        neighbours.
    """

    method: str
    columns: list[str]
    atoms: int
    frames: int
    dimension: int
    reference: int
    distance: float
    cell: float | None
    cutoff: float | None
    undefined: int
