"""Which strain to compute, and the lengths that it needs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.background import GridOptions, Weights
from gimpmd_strain.measures import MEASURES, Measure
from gimpmd_strain.virial import CUTOFF

Method = Literal["incremental", "total", "virial"]

CELL = 2.5
"""Default edge of a cell, in distances of neighbours; close to the larger one of the paper."""


@dataclass(frozen=True)
class Settings:
    """What to compute; lengths that are left out follow from the distance of neighbours.

    Attributes
    ----------
    method : {"incremental", "total", "virial"}
        Sum of strain increments (paper Eqs. 5 to 8), strain of the total displacement (Eq. 6 on
        the reference), or strain from the distances of neighbours (Eqs. 3 and 4).
    cell, spacing : float, optional
        Edges of a cell of the grid and of an atom (length units). The defaults are ``CELL``
        distances and one distance.
    weights : {"linear", "quadratic", "gimp"}
        See ``GridOptions``.
    measure : {"infinitesimal", "green", "almansi"}
        Strain tensor of the method ``total``. The other methods have their own: ``incremental``
        sums infinitesimal strains, and ``virial`` gives the Almansi strain.
    cutoff : float, optional
        Range of neighbours of the method ``virial`` (length units); by default ``CUTOFF``
        distances.
    """

    method: Method = "incremental"
    cell: float | None = None
    spacing: float | None = None
    weights: Weights = "linear"
    measure: Measure = "infinitesimal"
    cutoff: float | None = None

    def __post_init__(self) -> None:
        choices = {
            "method": get_args(Method),
            "weights": get_args(Weights),
            "measure": tuple(MEASURES),
        }
        problems = [
            Problem(key, getattr(self, key), "is unknown", f"one of {', '.join(known)}")
            for key, known in choices.items()
            if getattr(self, key) not in known
        ]
        problems += [
            Problem(key, value, "is not a length", "give a positive number, or leave it out")
            for key in ("cell", "spacing", "cutoff")
            if (value := getattr(self, key)) is not None and not 0.0 < value < float("inf")
        ]
        if self.measure != "infinitesimal" and self.method != "total":
            hint = "leave it out, or use the method total"
            problems.append(Problem("measure", self.measure, "is for the method total only", hint))
        if problems:
            raise InputError("atomic strain", problems)

    def resolved(self, distance: float) -> Settings:
        """Fill in all lengths, given the distance of neighbours in the reference.

        Raises
        ------
        InputError
            The cell is smaller than an atom.
        """
        spacing = distance if self.spacing is None else self.spacing
        cell = max(CELL * distance, spacing) if self.cell is None else self.cell
        cutoff = CUTOFF * distance if self.cutoff is None else self.cutoff
        if cell < spacing:
            message = f"is smaller than an atom, which is {spacing:.6g} wide"
            hint = f"use 2 to 3 distances of neighbours, for example {CELL * distance:.3g}"
            raise InputError("atomic strain", [Problem("cell", cell, message, hint)])
        return replace(self, spacing=spacing, cell=cell, cutoff=cutoff)

    def grid(self) -> GridOptions:
        """Return the options of the grid; the lengths must be known."""
        assert self.cell is not None
        assert self.spacing is not None
        return GridOptions(self.cell, self.spacing, self.weights)
