"""Potentials of several types and sub-styles with sites that are off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.errors import BackendError

ALLOYS = {
    "eam": Potential(("eam",), (("1", "1", "Cu_u3.eam"), ("2", "2", "Cu_u3.eam"))),
    "eam/alloy": Potential(("eam/alloy",), (("*", "*", "NiAlH_jea.eam.alloy", "Al", "Ni"),)),
    "eam/fs": Potential(("eam/fs",), (("*", "*", "AlFe_mm.eam.fs", "Al", "Fe"),)),
    "pairs": Potential(
        ("morse", "5.0"), (("1", "1*2", "0.3", "1.4", "2.9"), ("2", "2", "0.2", "1.5", "2.8"))
    ),
    "overlay": Potential(
        ("hybrid/overlay", "eam/alloy", "zbl", "2.0", "3.5"),
        (
            ("*", "*", "eam/alloy", "NiAlH_jea.eam.alloy", "Al", "Ni"),
            ("1", "1", "zbl", "13", "13"),
            ("1", "2", "zbl", "13", "28"),
            ("2", "2", "zbl", "28", "28"),
        ),
    ),
    "tersoff": Potential(("tersoff",), (("*", "*", "SiC.tersoff", "Si", "C"),)),
}


def energies(potential: Potential, types: np.ndarray, folder: Path, kinds: int) -> np.ndarray:
    """Energy of each atom of a crystal shaken at random, and the sum of all in front."""
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    try:
        engine.commands(
            [
                "units metal",
                "boundary s s s",
                "lattice fcc 4.0",
                "region box block -0.1 2.9 -0.1 1.9 -0.1 1.9",
                f"create_box {kinds} box",
                "create_atoms 1 region box",
                "displace_atoms all random 0.2 0.2 0.2 42",
                *potential.commands(),
                "mass * 1.0",
            ]
        )
        engine.atoms("type")[np.argsort(engine.atoms("id"))] = types
        engine.commands(
            [
                "compute each all pe/atom",
                "compute sum all reduce sum c_each",
                "thermo_style custom pe c_sum",
                "run 0",
            ]
        )
        each = engine.per_atom("each")[np.argsort(engine.atoms("id"))]
        return np.array([engine.thermo("pe"), *each])
    finally:
        engine.close()


@pytest.mark.parametrize("name", ALLOYS)
def test_with_all_sites_on_the_potential_is_the_users(name: str, folder: Path) -> None:
    types = np.random.default_rng(1).integers(1, 3, 48)
    own = energies(ALLOYS[name], types, folder, 2)
    doubled = energies(with_off_sites(ALLOYS[name], 2, folder), types, folder, 4)
    np.testing.assert_allclose(doubled, own, rtol=1e-12)


@pytest.mark.parametrize("name", [name for name in ALLOYS if name != "tersoff"])
def test_with_some_off_the_energy_is_that_of_the_other_sites(name: str, folder: Path) -> None:
    """LAMMPS gives the energies of sites for these styles; three-body ones it shares out."""
    rng = np.random.default_rng(2)
    types, off = rng.integers(1, 3, 48), rng.random(48) < 0.4
    sites = energies(ALLOYS[name], types, folder, 2)[1:]
    doubled = with_off_sites(ALLOYS[name], 2, folder)
    found = energies(doubled, types + 2 * off, folder, 4)[0]
    assert found == pytest.approx(sites[~off].sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("style", "coeffs", "words"),
    [
        ("meam", ["* * library.meam Cu NULL Cu"], "pair_style meam: .* sums over pairs and for"),
        ("hybrid zbl 1 2", ["1 1 zbl 1 1"], "write hybrid/overlay"),
        ("lj/cut 2.5", ["1 1 1 1", "2 2 1 1"], "types 1 and 2 too"),
        ("eam", ["1 1 Cu_u3.eam"], "no potential file for type 2"),
        ("eam", ["1 1 Cu_u3.eam", "2 2 Ni_u3.eam"], "different spacings; use an eam/alloy file"),
        ("eam/alloy", ["* * Cu_mishin1.eam.alloy Cu Ni"], "no element Ni, only Cu"),
        ("eam/alloy", ["* * AlFe_mm.eam.fs Al Al"], "is no potential file of pair_style eam/alloy"),
        ("eam/alloy", ["* * Cu_mishin1.eam.alloy Cu NULL"], "an element for each of the 2 types"),
        ("sw", ["* * Si.tersoff Si Si"], "is no potential file of pair_style sw"),
        ("sw", ["* * Si.sw Si C"], "has no entry"),
    ],
)
def test_what_cannot_be_done_is_refused(
    style: str, coeffs: list[str], words: str, folder: Path
) -> None:
    potential = Potential(tuple(style.split()), tuple(tuple(row.split()) for row in coeffs))
    with pytest.raises(BackendError, match=words):
        with_off_sites(potential, 2, folder)
