"""A potential with a second type for each type of atom, whose sites are off."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gimpmd_md.engines.lammps.library import is_of_distance, without_accelerator
from gimpmd_md.engines.lammps.site_off import setfl, snap, threebody
from gimpmd_md.engines.lammps.site_off.commands import Potential, find_file, numbers_of
from gimpmd_schemas.errors import BackendError

Coeffs = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Part:
    """One pair style with its coefficients, and the factor of its energies.

    Attributes
    ----------
    style : tuple of str
        Name and arguments.
    coeffs : tuple of tuple of str
        Words of ``pair_coeff`` without the name of the style.
    factor : float
    """

    style: tuple[str, ...]
    coeffs: Coeffs
    factor: float = 1.0


def with_off_sites(potential: Potential, types: int, folder: Path) -> Potential:
    """Make the potential whose sites of type ``t + types`` are off, t from 1 to types.

    Parameters
    ----------
    potential : Potential
        The user's own.
    types : int
        Number of types of atoms that it is for.
    folder : Path
        Where its files are written.

    Raises
    ------
    BackendError
        gimpmd cannot switch off sites of this pair style, or a file is not of its format.
    """
    parts = [half for part in _parts(potential) for half in _double(part, types, folder)]
    if len(parts) == 1:
        return Potential(parts[0].style, parts[0].coeffs, potential.modify)
    return _joined(parts, types, potential.modify)


def _parts(potential: Potential) -> list[Part]:
    """The pair styles that are summed."""
    name, *words = potential.style
    if name == "hybrid/overlay":
        return _parts_of_hybrid(words, potential.coeffs)
    if name.startswith("hybrid"):
        raise BackendError(
            f"pair_style {name}: gimpmd can switch off sites of hybrid/overlay, but not of this "
            "style; write hybrid/overlay"
        )
    return [Part(potential.style, potential.coeffs)]


def _parts_of_hybrid(words: Sequence[str], coeffs: Coeffs) -> list[Part]:
    named = {row[2] for row in coeffs}
    places = [k for k, word in enumerate(words) if word in named]
    names = [words[k] for k in places]
    if len(set(names)) < len(names):
        raise BackendError(
            "pair_style hybrid/overlay: gimpmd cannot switch off sites where a sub-style is used "
            "twice"
        )
    ends = [*places[1:], len(words)]
    return [
        Part(
            tuple(words[start:end]),
            tuple((*row[:2], *row[3:]) for row in coeffs if row[2] == words[start]),
        )
        for start, end in zip(places, ends, strict=True)
    ]


def _double(part: Part, types: int, folder: Path) -> list[Part]:
    """The parts that take the place of one, for twice as many types."""
    name = without_accelerator(part.style[0])
    if name in _MANY_BODY:
        return [_MANY_BODY[name](part, types, folder)]
    if is_of_distance(name):
        return _double_pairs(part, types)
    raise BackendError(
        f"pair_style {name}: gimpmd cannot switch off sites of this style; it can do so for sums "
        f"over pairs and for {', '.join(_MANY_BODY)}"
    )


def _double_pairs(part: Part, types: int) -> list[Part]:
    """All pairs, and once more, with half their energy, those with one atom that is off."""
    whole: dict[tuple[int, int], tuple[str, ...]] = {}
    for first, second, *rest in part.coeffs:
        for i in numbers_of(first, types):
            for j in numbers_of(second, types):
                if i <= j or first == second:
                    whole[min(i, j), max(i, j)] = tuple(rest)
    missing = [(i, j) for j in range(1, types + 1) for i in range(1, j + 1) if (i, j) not in whole]
    if missing:
        raise BackendError(
            f"pair_coeff: give the coefficients of types {missing[0][0]} and {missing[0][1]} too; "
            "gimpmd cannot switch off sites of mixed coefficients"
        )
    half = {}
    for (i, j), words in whole.items():
        half[i, j + types] = half[j, i + types] = words
    both, one = (
        tuple((str(i), str(j), *words) for (i, j), words in pairs.items())
        for pairs in (whole, half)
    )
    return [Part(part.style, both), Part(part.style, one, 0.5)]


def tables_of(potential: Potential, types: int) -> setfl.Tables | None:
    """Tables of a potential by embedded atoms, with an element for each type; None for others.

    Raises
    ------
    BackendError
        A file is missing, or not of its format.
    """
    part, name = Part(potential.style, potential.coeffs), without_accelerator(potential.style[0])
    if name == "eam":
        return _tables_of_elements(part, types)
    if name in ("eam/alloy", "eam/fs"):
        return _tables_of_alloy(part, types)
    return None


def _double_eam(part: Part, types: int, folder: Path) -> Part:
    """Tables of the files of single elements become those of an alloy."""
    style = part.style[0].replace("eam", "eam/alloy", 1)
    tables = _tables_of_elements(part, types)
    return _of_tables(tables, (style, *part.style[1:]), tables.names, folder)


def _tables_of_elements(part: Part, types: int) -> setfl.Tables:
    paths = [find_file(name) for name in _files_of_types(part, types)]
    return setfl.read_funcfls(paths, [f"T{number}" for number in range(1, types + 1)])


def _files_of_types(part: Part, types: int) -> list[str]:
    """The funcfl file of each type."""
    files = {}
    for first, second, name, *_ in part.coeffs:
        for i in numbers_of(first, types):
            if i in numbers_of(second, types):
                files[i] = name
    missing = [i for i in range(1, types + 1) if i not in files]
    if missing:
        raise BackendError(f"pair_coeff: no potential file for type {missing[0]}")
    return [files[i] for i in range(1, types + 1)]


def _double_setfl(part: Part, types: int, folder: Path) -> Part:
    tables = _tables_of_alloy(part, types)
    used = tables.take(list(dict.fromkeys(tables.names)))
    return _of_tables(used, part.style, tables.names, folder)


def _tables_of_alloy(part: Part, types: int) -> setfl.Tables:
    (file,), names = _files_and_names(part, 1, types)
    pair_densities = without_accelerator(part.style[0]) == "eam/fs"
    return setfl.read_setfl(find_file(file), pair_densities).take(names)


def _of_tables(
    tables: setfl.Tables, style: tuple[str, ...], names: Sequence[str], folder: Path
) -> Part:
    path = folder / "site_off.eam"
    setfl.write_setfl(setfl.with_off_sites(tables), path)
    return Part(style, (_for_all([path], names),))


def _double_threebody(part: Part, types: int, folder: Path) -> Part:
    (file,), names = _files_and_names(part, 1, types)
    style = without_accelerator(part.style[0])
    comment, entries = threebody.read_entries(find_file(file), style)
    path = folder / f"site_off.{style}"
    doubled = threebody.with_off_sites(entries, list(dict.fromkeys(names)), style)
    threebody.write_entries(comment, doubled, path)
    return Part(part.style, (_for_all([path], names),))


def _double_snap(part: Part, types: int, folder: Path) -> Part:
    (coefficients, parameters), names = _files_and_names(part, 2, types)
    comment, elements = snap.read_elements(find_file(coefficients))
    snap.check_parameters(find_file(parameters))
    missing = [name for name in names if name not in elements]
    if missing:
        raise BackendError(f"{coefficients}: has no element {missing[0]}")
    path = folder / "site_off.snapcoeff"
    snap.write_elements(comment, [elements[name] for name in dict.fromkeys(names)], path)
    return Part(part.style, (_for_all([path, find_file(parameters)], names),))


def _files_and_names(part: Part, count: int, types: int) -> tuple[list[str], list[str]]:
    """Files and elements of ``pair_coeff * * file ... element ...``."""
    words = part.coeffs[-1][2:] if part.coeffs else ()
    files, names = list(words[:count]), list(words[count:])
    if len(part.coeffs) != 1 or len(names) != types or "NULL" in names:
        raise BackendError(
            f"pair_style {part.style[0]}: give one pair_coeff * * with an element for each of the "
            f"{types} types of atoms"
        )
    return files, names


def _for_all(files: Sequence[Path], names: Sequence[str]) -> tuple[str, ...]:
    off = [name + setfl.OFF for name in names]
    return ("*", "*", *map(str, files), *names, *off)


def _joined(parts: Sequence[Part], types: int, modify: Coeffs) -> Potential:
    """The sum of the parts, each times its factor."""
    names = [part.style[0] for part in parts]
    style: list[str] = ["hybrid/scaled"]
    coeffs: list[tuple[str, ...]] = []
    for k, part in enumerate(parts):
        name = names[k]
        number = [str(names[: k + 1].count(name))] if names.count(name) > 1 else []
        style += [repr(part.factor), *part.style]
        coeffs += [(*row[:2], name, *number, *row[2:]) for row in part.coeffs]
    if not any(part.coeffs[0][:2] == ("*", "*") for part in parts):
        off = range(types + 1, 2 * types + 1)
        coeffs += [(str(i), str(j), "none") for j in off for i in off if i <= j]
    return Potential(tuple(style), tuple(coeffs), modify)


_MANY_BODY: Mapping[str, Callable[[Part, int, Path], Part]] = {
    "eam": _double_eam,
    "eam/alloy": _double_setfl,
    "eam/fs": _double_setfl,
    "sw": _double_threebody,
    "tersoff": _double_threebody,
    "snap": _double_snap,
}
