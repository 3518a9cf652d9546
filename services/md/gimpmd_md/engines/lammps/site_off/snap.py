"""Coefficients of SNAP potentials: the energy of a site is linear in them.

A site is off if all coefficients of its element are zero. As a neighbour the element keeps its
radius and weight [1]_.

.. [1] A. P. Thompson et al., J. Comput. Phys. 285, 316 (2015).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gimpmd_md.engines.lammps.site_off.setfl import OFF
from gimpmd_schemas.errors import BackendError

BY_ELEMENT = ("chemflag", "switchinnerflag")
"""Settings of a parameter file with which more than the coefficients depends on the element."""


@dataclass(frozen=True)
class Element:
    """Name, radius, weight and coefficients of an element, as words."""

    name: str
    radius: str
    weight: str
    coefficients: tuple[str, ...]


def read_elements(path: Path) -> tuple[str, dict[str, Element]]:
    """Read a file of coefficients: its first line, and the elements by name.

    Raises
    ------
    BackendError
        The file is not of this format.
    """
    lines = path.read_text(errors="replace").splitlines()
    words = " ".join(line.split("#")[0] for line in lines).split()
    try:
        count, size = int(words[0]), int(words[1])
        if len(words) != 2 + count * (3 + size):
            raise ValueError(f"{len(words)} words, not {2 + count * (3 + size)}")
    except (IndexError, ValueError) as error:
        raise BackendError(f"{path}: is no file of SNAP coefficients: {error}") from None
    found = {}
    for start in range(2, len(words), 3 + size):
        name, radius, weight, *coefficients = words[start : start + 3 + size]
        found[name] = Element(name, radius, weight, tuple(coefficients))
    return lines[0] if lines[0].startswith("#") else "#", found


def check_parameters(path: Path) -> None:
    """Raise `BackendError` if the parameters treat neighbours by their element."""
    for line in path.read_text(errors="replace").splitlines():
        words = line.split("#")[0].split()
        if len(words) > 1 and words[0] in BY_ELEMENT and words[1] != "0":
            raise BackendError(
                f"{path}: {words[0]} {words[1]}: gimpmd cannot switch off sites of a SNAP "
                "potential that tells the elements of neighbours apart"
            )


def write_elements(comment: str, elements: Sequence[Element], path: Path) -> None:
    """Write the coefficients of elements, and of those whose sites are off."""
    off = [
        Element(e.name + OFF, e.radius, e.weight, ("0.0",) * len(e.coefficients)) for e in elements
    ]
    rows = [comment, f"{2 * len(elements)} {len(elements[0].coefficients)}"]
    for e in (*elements, *off):
        rows += [f"{e.name} {e.radius} {e.weight}", *e.coefficients]
    path.write_text("\n".join(rows) + "\n")
