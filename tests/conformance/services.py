"""The services that are checked: their options of ``gimpmd check service``."""

from __future__ import annotations

from dataclasses import dataclass
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


BODIES = {
    "": [],
    "several ranks": ["--ranks", "2", "--peers", "2"],
    "levels": ["--body", "levels"],
    "space": ["--body", "space"],
    "space on several ranks": ["--body", "space", "--ranks", "2", "--peers", "2"],
}
"""Options of the bodies by their names in the table; the first is the strip on one rank."""

GROUPS = "registration,course,checkpoint,translation,uniform strain,rotation"
"""The groups of checks that are made with bodies other than the strip."""

PATIENCE = ["--deadline", "60"]
"""The check is about what services do, not how fast: it also runs on a machine that is busy."""

EVERYTHING = ("lammps", "gimp")
"""The codes that must pass with every body; the others may refuse all but the strip."""


@dataclass(frozen=True)
class Asked:
    """A check that is asked for.

    Attributes
    ----------
    code : name of the code.
    body : name of the body.
    options : of ``gimpmd check service``.
    """

    code: str
    body: str
    options: list[str]

    @property
    def name(self) -> str:
        """Name in the table."""
        return f"{self.code}, {self.body}" if self.body else self.code

    @property
    def must_pass(self) -> bool:
        """Whether the code may not refuse the body."""
        return not self.body or self.code in EVERYTHING


def services(folder: Path) -> list[Asked]:
    """All checks of all services; inputs of ASE are written into the folder.

    The service in Rust is among them if it has been built.
    """
    codes = {
        "lammps": (["--side", "md"], []),
        "gimp": (["--side", "continuum"], []),
        "fem": (["--side", "continuum", "--backend", "fem"], []),
    }
    if PROGRAM.exists():
        codes["foreign"] = (["--side", "continuum"], ["--", str(PROGRAM)])
    asked = [Asked("ase", "", ["--side", "md", *PATIENCE, *ase_cases(folder)])]
    for code, (options, command) in codes.items():
        for body, chosen in BODIES.items():
            groups = ["--groups", GROUPS] if body else []
            asked.append(Asked(code, body, [*options, *PATIENCE, *chosen, *groups, *command]))
    return asked


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
