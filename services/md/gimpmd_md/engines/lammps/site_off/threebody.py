"""Files of Stillinger-Weber and Tersoff potentials: one entry for each triple of elements.

The first element of an entry is that of the atom in the middle, whose site the three-body energy
belongs to. The energy of the pair of the first two elements belongs half to each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

from gimpmd_md.engines.lammps.site_off.setfl import OFF
from gimpmd_schemas.errors import BackendError

Triple = tuple[str, str, str]
Entries = Mapping[Triple, tuple[str, ...]]
Change = Callable[[Sequence[bool], list[str]], None]

_SW_LAMBDA, _SW_A, _SW_WORDS = 3, 6, 11
_TERSOFF_B, _TERSOFF_A, _TERSOFF_WORDS = 9, 13, 14
"""Places of the factors of the energies among the numbers of an entry, and how many there are."""

WORDS = {"sw": _SW_WORDS, "tersoff": _TERSOFF_WORDS}
"""Numbers of an entry by pair style."""


def read_entries(path: Path, style: str) -> tuple[str, dict[Triple, tuple[str, ...]]]:
    """Read a file of ``sw`` or ``tersoff``.

    Returns
    -------
    comment : str
        First line, from which LAMMPS reads the units.
    entries : dict
        Numbers, as words, by triple of elements.

    Raises
    ------
    BackendError
        The file is not of this format.
    """
    lines, size = path.read_text(errors="replace").splitlines(), 3 + WORDS[style]
    words = " ".join(line.split("#")[0] for line in lines).split()
    if not words or len(words) % size:
        raise BackendError(
            f"{path}: is no potential file of pair_style {style}: {len(words)} words are no whole "
            f"number of entries of {size}"
        )
    entries = {}
    for start in range(0, len(words), size):
        first, second, third, *numbers = words[start : start + size]
        entries[first, second, third] = tuple(numbers)
    return lines[0] if lines[0].startswith("#") else "#", entries


def with_off_sites(entries: Entries, names: Sequence[str], style: str) -> Entries:
    """Entries of all triples of the elements and of those whose sites are off.

    Raises
    ------
    BackendError
        An entry is missing.
    """
    change, doubled = _CHANGES[style], {}
    kinds = [(name, True) for name in names] + [(name, False) for name in names]
    for triple in product(kinds, repeat=3):
        bare: Triple = (triple[0][0], triple[1][0], triple[2][0])
        if bare not in entries:
            raise BackendError(f"the potential file of pair_style {style} has no entry {bare}")
        numbers = list(entries[bare])
        change([on for _, on in triple], numbers)
        first, second, third = (name if on else name + OFF for name, on in triple)
        doubled[first, second, third] = tuple(numbers)
    return doubled


def write_entries(comment: str, entries: Entries, path: Path) -> None:
    """Write a file of ``sw`` or ``tersoff``."""
    rows = [f"{' '.join(triple)} {' '.join(numbers)}" for triple, numbers in entries.items()]
    made = "# Made by gimpmd: the sites of elements whose names end with 0 are off"
    path.write_text("\n".join([comment, made, *rows]) + "\n")


def _scale(numbers: list[str], place: int, factor: float) -> None:
    numbers[place] = repr(factor * float(numbers[place]))


def _change_sw(on: Sequence[bool], numbers: list[str]) -> None:
    _scale(numbers, _SW_A, 0.5 * (on[0] + on[1]))
    _scale(numbers, _SW_LAMBDA, float(on[0]))


def _change_tersoff(on: Sequence[bool], numbers: list[str]) -> None:
    _scale(numbers, _TERSOFF_A, 0.5 * (on[0] + on[1]))
    _scale(numbers, _TERSOFF_B, float(on[0]))


_CHANGES: Mapping[str, Change] = {"sw": _change_sw, "tersoff": _change_tersoff}
