"""The services that are checked: their options of ``gimpmd check service``."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gimpmd_deploy.check.cases import BLOCK, STRIP
from gimpmd_deploy.launch.asking import ask_lammps
from gimpmd_schemas.case.load import dump_case, load_case
from gimpmd_schemas.resolve import fill_in
from tests.physics.sides import PROGRAM
from tests.services.md.block import A
from tests.services.md.engines.ase import inputs

ASE_INPUT = "block.yaml"
MODULE = inputs.MODULE.replace(
    "LennardJonesCut(1.0, 1.0, 2.5)", "LennardJonesCut(1.0, 1.0 / A, 2.5 / A)"
).replace("def make", f"A = {A!r}\n\ndef make")
"""The potential of the built-in cases, whose crystal has the lattice constant 1."""


def services(folder: Path) -> dict[str, list[str]]:
    """Options for each service by its name; inputs of ASE are written into the folder.

    The service in Rust is among them if it has been built.
    """
    found = {
        "lammps": ["--side", "md"],
        "ase": ["--side", "md", *ase_cases(folder)],
        "gimp": ["--side", "continuum"],
        "fem": ["--side", "continuum", "--backend", "fem"],
    }
    if PROGRAM.exists():
        found["foreign"] = ["--side", "continuum", "--", str(PROGRAM)]
    return found


def ase_cases(folder: Path) -> list[str]:
    """Write the built-in cases for ASE, with what LAMMPS measures filled in, and name them."""
    folder.mkdir(parents=True, exist_ok=True)
    crystal = {**inputs.CRYSTAL, "cell": [1.0, 3**0.5]}
    inputs.write(folder, calculator=inputs.FAST, crystal=crystal)
    (folder / inputs.MODULE_FILE).write_text(MODULE)
    words = []
    for option, path, only in (("--case", STRIP, None), ("--free-case", BLOCK, "md")):
        case = msgspec.structs.replace(load_case(path), only=only)
        named = folder / f"case-{path.name}"  # the input has the other name
        measured = fill_in(case, ask_lammps(case, path), path)
        atoms = msgspec.structs.replace(
            measured.atoms,
            backend="ase",
            input=ASE_INPUT,
            files=(inputs.MODULE_FILE,),
            variables={},
        )
        dump_case(msgspec.structs.replace(measured, md=atoms, only=None), named)
        words += [option, str(named)]
    return words
