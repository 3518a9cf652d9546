"""The commands that define a potential in LAMMPS, as its log echoes them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gimpmd_md.engines.lammps.library import own_potentials
from gimpmd_schemas.errors import BackendError


@dataclass(frozen=True)
class Potential:
    """A potential as the words of LAMMPS's commands.

    Attributes
    ----------
    style : tuple of str
        Words of ``pair_style``.
    coeffs : tuple of tuple of str
        Words of each ``pair_coeff``.
    modify : tuple of tuple of str
        Words of each ``pair_modify``.
    """

    style: tuple[str, ...]
    coeffs: tuple[tuple[str, ...], ...]
    modify: tuple[tuple[str, ...], ...] = ()

    def commands(self) -> list[str]:
        """The commands, in the order in which LAMMPS wants them."""
        return [
            f"pair_style {' '.join(self.style)}",
            *(f"pair_coeff {' '.join(words)}" for words in self.coeffs),
            *(f"pair_modify {' '.join(words)}" for words in self.modify),
        ]


def commands_in(log: str) -> Iterator[str]:
    """The commands of a LAMMPS log, without comments and variables.

    LAMMPS echoes every command of a script, of the files that it includes and of its loops. A line
    with variables is echoed twice, the second time with their values.
    """
    for line in log.replace("&\n", " ").splitlines():
        command = line.split("#")[0]
        if "$" not in line and command.strip():
            yield command


def potential_in(log: str) -> Potential:
    """The potential of a LAMMPS log: the last ``pair_style`` and what follows it.

    Parameters
    ----------
    log : str
        Text of the log.

    Raises
    ------
    BackendError
        The log has no ``pair_style``.
    """
    style: tuple[str, ...] = ()
    coeffs: list[tuple[str, ...]] = []
    modify: list[tuple[str, ...]] = []
    for line in commands_in(log):
        command, *words = line.split()
        if command == "pair_style":
            style, coeffs, modify = tuple(words), [], []
        elif command == "pair_coeff":
            coeffs.append(tuple(words))
        elif command == "pair_modify":
            modify.append(tuple(words))
    if not style:
        raise BackendError("the LAMMPS script sets no pair_style, so the atoms have no forces")
    return Potential(style, tuple(coeffs), tuple(modify))


def find_file(name: str) -> Path:
    """A potential file where LAMMPS finds it: in the working directory, or in its own folder.

    Raises
    ------
    BackendError
        There is no such file.
    """
    folder = Path(os.environ.get("LAMMPS_POTENTIALS", own_potentials()))
    for path in (Path(name), folder / name):
        if path.is_file():
            return path
    raise BackendError(f"{name}: no such potential file in {Path.cwd()}; name it in md.files")


def numbers_of(words: str, types: int) -> range:
    """Types that a word of ``pair_coeff`` stands for: ``2``, ``*``, ``1*3``, ``2*`` or ``*2``."""
    if "*" not in words:
        return range(int(words), int(words) + 1)
    first, _, last = words.partition("*")
    return range(int(first or 1), int(last or types) + 1)
