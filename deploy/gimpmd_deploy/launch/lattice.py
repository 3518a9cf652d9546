"""A crystal at zero pressure and temperature: the MD service measures it and answers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import msgspec

from gimpmd_deploy.launch.asking import ask
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.wire.lattice import Crystal, Potential, Question, Structure, Style


def lattice_of_script(script: Path) -> Crystal:
    """Measure the crystal in the periodic cell of a LAMMPS script.

    Raises
    ------
    InputError
        There is no such file.
    BackendError, PeerLostError
        See `gimpmd_deploy.launch.asking.ask`.
    """
    if not script.is_file():
        problem = Problem("file", None, "does not exist", "name a LAMMPS script of a periodic cell")
        raise InputError(str(script), [problem])
    return _ask(Question(script=script.name), script.parent, "", str(script))


def lattice_of_potential(
    pair: str | None,
    crystal: str | None,
    units: str | None,
    file: str | None,
    elements: Sequence[str],
    coefficients: Sequence[str],
    mass: float | None,
) -> Crystal:
    """Measure a crystal of one element, given its potential and its structure.

    Parameters
    ----------
    pair, crystal, units : str
        Arguments of ``pair_style``, crystal structure and unit style; all must be given.
    file, elements : str and sequence of str
        Potential file, and the words after it: ``pair_coeff * * FILE ELEMENT``.
    coefficients : sequence of str
        In place of them, arguments of ``pair_coeff`` commands.
    mass : float, optional
        Mass of an atom.

    Raises
    ------
    InputError
        An option is missing.
    BackendError, PeerLostError
        See `gimpmd_deploy.launch.asking.ask`.
    """
    problems = [
        Problem(option, None, "is missing", hint)
        for option, value, hint in (
            ("--pair", pair, "give the pair style, or a LAMMPS script of a periodic cell"),
            ("--crystal", crystal, "give the crystal structure, such as fcc"),
            ("--units", units, "give the unit style of the potential, such as metal"),
            ("--file", file or coefficients, "give the potential file, or --coeff"),
        )
        if not value
    ]
    if file and coefficients:
        problems.append(
            Problem("--coeff", None, "is given in addition to --file", "remove one of the two")
        )
    if problems or pair is None:
        raise InputError("gimpmd lattice", problems)
    if file:
        path = Path(file)
        place = path.resolve() if path.is_file() else path  # LAMMPS looks among its own files
        coefficients = [" ".join(["* *", f'"{place}"', *elements])]
    potential = Potential(
        structure=cast(Structure, crystal),
        units=cast(Style, units),
        pair_style=pair,
        pair_coeff=tuple(coefficients),
        mass=mass,
    )
    return _ask(Question(potential=potential), Path.cwd(), "", f"the potential {pair}")


def _ask(question: Question, folder: Path, about: str, reads: str) -> Crystal:
    text = msgspec.json.encode(question).decode()
    return ask(["lattice", "--question", text], folder, about, reads, Crystal)
