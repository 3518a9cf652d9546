"""What strain to compute, and the lengths that go with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.background import GridOptions, Weights
from gimpmd_strain.measures import MEASURES, Measure
from gimpmd_strain.virial import REACH

Method = Literal["incremental", "total", "virial"]

CELL = 2.5
"""Default edge of a cell over the distance of neighbours, near the larger one of the paper."""


@dataclass(frozen=True)
class Settings:
    """What to compute; lengths left out follow from the distance of neighbours.

    Attributes
    ----------
    method : {"incremental", "total", "virial"}
        Sum of strain increments (paper Eqs. 5 to 8), strain of the total displacement (Eq. 6
        on the reference), or strain of the neighbours' distances (Eqs. 3 and 4).
    cell, spacing : float, optional
        Edges of the grid's cells (``CELL`` distances) and of an atom (one distance).
    weights : {"linear", "quadratic", "gimp"}
        See ``GridOptions``.
    measure : {"infinitesimal", "green", "almansi"}
        Strain tensor of ``total``. The others have their own: ``incremental`` a sum of
        infinitesimal ones, ``virial`` Almansi's.
    cutoff : float, optional
        Range of neighbours of ``virial`` (``REACH`` distances).
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
            Problem(key, value, "is no length", "give a positive number, or leave it out")
            for key in ("cell", "spacing", "cutoff")
            if (value := getattr(self, key)) is not None and not 0.0 < value < float("inf")
        ]
        if self.measure != "infinitesimal" and self.method != "total":
            hint = "leave it out, or use method total"
            problems.append(Problem("measure", self.measure, "is for method total", hint))
        if problems:
            raise InputError("atomic strain", problems)

    def resolved(self, distance: float) -> Settings:
        """With all lengths, given the distance of neighbours in the reference.

        Raises
        ------
        InputError
            The cell is smaller than an atom.
        """
        spacing = distance if self.spacing is None else self.spacing
        cell = max(CELL * distance, spacing) if self.cell is None else self.cell
        cutoff = REACH * distance if self.cutoff is None else self.cutoff
        if cell < spacing:
            message = f"is smaller than an atom, which is {spacing:.6g} wide"
            hint = f"use 2 to 3 distances of neighbours, that is about {CELL * distance:.3g}"
            raise InputError("atomic strain", [Problem("cell", cell, message, hint)])
        return replace(self, spacing=spacing, cell=cell, cutoff=cutoff)

    def grid(self) -> GridOptions:
        """Options of the grid; the lengths must be known."""
        assert self.cell is not None
        assert self.spacing is not None
        return GridOptions(self.cell, self.spacing, self.weights)
