"""Atoms with a second type for sites that are off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.off_types import double_types
from gimpmd_schemas.errors import BackendError

SCRIPT = """\
units {units}
dimension {dim}
boundary s p {z}
newton on
lattice {lattice}
region some block 0 7 0 4 {nz}
region all block 0 7 0 4 {nz}
create_box {types} all
create_atoms 1 region some
{more}
{potential}
neighbor 0.7 bin
neigh_modify delay 0 every 2 check yes
"""

LJ = {
    "units": "lj",
    "dim": 2,
    "z": "p",
    "lattice": "hex 0.9317984",
    "nz": "-0.5 0.5",
    "types": 2,
    "more": "set group all type/fraction 2 0.3 9421\nmass 1 1.0\nmass 2 2.5",
    "potential": "pair_style lj/cut 2.5\npair_coeff 1 1 1.0 1.0\npair_coeff 1 2 1.1 1.0\n"
    "pair_coeff 2 2 0.9 1.0",
}

EAM = {
    "units": "metal",
    "dim": 3,
    "z": "p",
    "lattice": "fcc 3.615",
    "nz": "0 3",
    "types": 1,
    "more": "",
    "potential": "variable element index Cu\npair_style eam/alloy\n"
    "pair_coeff * * Cu_mishin1.eam.alloy ${{element}}\nmass 1 60.0",
}


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    made = Engine(MPI.COMM_SELF, tmp_path / "log.lammps")
    yield made
    made.close()


def read(engine: Engine, values: dict[str, object], added: str = "") -> None:
    path = engine.log.with_name("in.lammps")
    text = SCRIPT.format(**values).replace("{{", "{").replace("}}", "}")
    path.write_text(text + added)
    engine.script(str(path), {})


def by_id(engine: Engine, name: str) -> np.ndarray:
    return np.asarray(engine.atoms(name))[np.argsort(engine.atoms("id"))].copy()


def energies(engine: Engine) -> np.ndarray:
    """Energies of the atoms, in the order of their ids."""
    engine.commands(["compute each all pe/atom", "fix each all ave/atom 1 1 1 c_each", "run 0"])
    found = engine.stored("each")[np.argsort(engine.atoms("id"))].copy()
    engine.commands(["unfix each", "uncompute each"])
    return np.asarray(found)


@pytest.mark.parametrize("values", [LJ, EAM], ids=["LJ", "EAM"])
def test_energy_is_that_of_the_sites_that_are_on(
    engine: Engine, tmp_path: Path, values: dict[str, object]
) -> None:
    read(engine, values)
    whole, x, kinds = energies(engine), by_id(engine, "x"), by_id(engine, "type")
    masses = np.asarray(engine.masses())[np.argsort(engine.atoms("id"))].copy()
    types = double_types("in.lammps", engine, tmp_path).types
    assert types == values["types"]
    np.testing.assert_allclose(by_id(engine, "x"), x, atol=1e-14)
    np.testing.assert_array_equal(by_id(engine, "type"), kinds)
    off = by_id(engine, "x").reshape(len(x), -1)[:, 0] > np.median(x.reshape(len(x), -1)[:, 0])
    engine.atoms("type")[np.argsort(engine.atoms("id"))[off]] += types
    found = energies(engine)
    assert engine.thermo("pe") == pytest.approx(found.sum(), rel=1e-12)
    assert engine.thermo("pe") == pytest.approx(whole[~off].sum(), rel=1e-12)
    now = np.asarray(engine.masses())[np.argsort(engine.atoms("id"))]
    np.testing.assert_array_equal(now, masses)


def test_neighbour_lists_are_those_of_the_script(engine: Engine, tmp_path: Path) -> None:
    read(engine, LJ)
    double_types("in.lammps", engine, tmp_path)
    engine.lammps.flush_buffers()
    text = engine.log.read_text().rpartition("Neighbor list info")[2]
    assert "update: every = 2 steps, delay = 0 steps, check = yes" in text
    assert "master list distance cutoff = 3.2" in text


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ("fix push all addforce 1.0 0.0 0.0\n", "fix push .addforce.: .* md.after"),
        ("pair_style lj/cut/coul/debye 1.4 2.5\npair_coeff * * 1.0 1.0\n", "cannot switch off"),
    ],
)
def test_what_would_be_lost_is_refused(
    engine: Engine, tmp_path: Path, added: str, said: str
) -> None:
    if "coul" in added:
        values = LJ | {"potential": added, "lattice": "hex 0.9317984"}
        path = engine.log.with_name("in.lammps")
        path.write_text(
            SCRIPT.format(**values).replace("newton on", "newton on\natom_style charge")
        )
        engine.script(str(path), {})
    else:
        read(engine, LJ, added)
    with pytest.raises(BackendError, match=said):
        double_types("in.lammps", engine, tmp_path)
