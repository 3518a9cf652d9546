"""Laws of crystals in space: their stress against that of LAMMPS at random strains.

The table gives the median and the largest error of the second Piola-Kirchhoff stress, over the
largest stress at strains of the same norm.

    python -m tests.physics.laws_in_space [COPPER SILICON ...] [--degree 4]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import msgspec
import numpy as np
from mpi4py import MPI

from gimpmd_gimp.laws import Law, make_law
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.probe import measure
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests import copper_sites
from tests.copper_sites import Metal, copper_case, write_scripts
from tests.services.gimp.laws.sample_laws import stress

SIZES = (0.005, 0.01, 0.02, 0.03, 0.05)
"""Norms of the strains."""

COUNT = 40
"""Random strains of each size."""


def cell_in(folder: Path) -> tuple[str, str, MPI.Comm, Path]:
    """What `open_cell` needs to know of the cell in a folder."""
    return str(folder / "cell.in"), "metal", MPI.COMM_SELF, folder / "log.lammps"


def law_of(asked: MeasuredByMd, metal: Metal, folder: Path) -> Law:
    """Law of a crystal by LAMMPS, in mechanical units."""
    write_scripts(folder, metal)
    script, units, comm, log = cell_in(folder)
    found = measure(msgspec.structs.replace(asked, cell=script), units, 3, comm, log)
    case = msgspec.convert(copper_case((8, 2, 2), ((2, 6), None, None), 0.32, metal), Case)
    continuum = msgspec.structs.replace(case.continuum, material=found)
    return make_law(make_plan(msgspec.structs.replace(case, continuum=continuum, only="continuum")))


def laws_of(metal: Metal, folder: Path, degree: int | None) -> dict[str, Law]:
    """Linear and finite law of a crystal, and the exact one of embedded atoms."""
    asked = {
        "linear": MeasuredByMd(cell="cell.in"),
        "finite": MeasuredByMd(cell="cell.in", model="cauchy-born", degree=degree),
    }
    if metal.style.startswith("eam") and metal.structure in ("fcc", "bcc"):
        asked["exact"] = MeasuredByMd(cell="cell.in", model="lattice-sum")
    return {name: law_of(one, metal, folder) for name, one in asked.items()}


def gradients(size: float, count: int) -> np.ndarray:
    """Upper triangular deformation gradients of random strains of this size."""
    A = np.random.default_rng(round(1e4 * size)).standard_normal((count, 3, 3))
    E = A + A.transpose(0, 2, 1)
    E *= size / np.linalg.norm(E, axis=(1, 2))[:, None, None]
    return np.asarray(np.linalg.cholesky(np.eye(3) + 2.0 * E).transpose(0, 2, 1)).copy()


def errors(law: Law, cell: Cell, size: float, count: int = COUNT) -> np.ndarray:
    """Errors of the second Piola-Kirchhoff stress, over the largest stress at this size."""
    F = gradients(size, count)
    rest, back = cell.deform(np.eye(3))[1], np.linalg.inv(F)
    unit = UNITS["metal"].stress_to_mechanical(1.0)
    exact = unit * np.array(
        [b @ cell.deform(f)[1] @ b.T - rest for f, b in zip(F, back, strict=True)]
    )
    if law.finite:
        found = back @ stress(law, F) @ back.transpose(0, 2, 1)
    else:  # its strain is E here, as in the table that it is compared with
        found = stress(law, np.eye(3) + 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3)))
    missing = np.linalg.norm(found - exact, axis=(1, 2))
    return np.asarray(missing / np.linalg.norm(exact, axis=(1, 2)).max())


def table(metal: Metal, folder: Path, degree: int | None = None) -> dict[str, np.ndarray]:
    """Medians and largest errors of the laws at each size of the strain, ``(sizes, 2)``."""
    laws = laws_of(metal, folder, degree)
    with open_cell(*cell_in(folder), dims=(3,)) as cell:
        found = {name: [errors(law, cell, size) for size in SIZES] for name, law in laws.items()}
    return {name: np.array([(np.median(e), e.max()) for e in rows]) for name, rows in found.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Errors of the stress of laws of crystals.")
    parser.add_argument("crystals", nargs="*", default=["COPPER"])
    parser.add_argument("--degree", type=int)
    options = parser.parse_args()
    print(f"{'strain':24}{''.join(f'{size:>18g}' for size in SIZES)}")
    for name in options.crystals:
        with tempfile.TemporaryDirectory() as folder:
            found = table(getattr(copper_sites, name), Path(folder), options.degree)
        for law, rows in found.items():
            numbers = "".join(f"{f'{m:.1e}/{most:.1e}':>18}" for m, most in rows)
            print(f"{name + ' ' + law:24}{numbers}", flush=True)


if __name__ == "__main__":
    main()
