"""The command ``gimpmd-md probe``, as a process, and the probe of other MD codes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md import probe as module
from gimpmd_md.crystal.cell import open_cell
from gimpmd_md.crystal.moduli import measure_all
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.materials import (
    J2,
    Elastic,
    Hyperelastic,
    MeasuredByMd,
    PairLattice,
    stiffness,
)
from gimpmd_schemas.errors import BackendError
from tests.copper_sites import write_scripts
from tests.services.md.toy_atoms import A, ToyAtoms

SERVICE = [sys.executable, "-m", "gimpmd_md.service"]
EXAMPLE = Path(__file__).parents[3] / "examples" / "mode1-small"


def probe(case: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [*SERVICE, "probe", "--case", str(case), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_probe_describes_the_example() -> None:
    done = probe(EXAMPLE / "case.yaml")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["cutoff"] == 2.5
    assert found["atoms"] == found["mass"] == 31122
    assert found["spacing"] == pytest.approx(1.0731935**0.5, rel=1e-6)
    assert found["material"]["lame"] == pytest.approx(27.8332, rel=1e-4)
    assert found["material"]["density"] == pytest.approx(0.9317984, rel=1e-6)


def test_probe_finds_the_bonds_of_the_crystal(folder: Path, make: Callable[..., Case]) -> None:
    material = {"from": "md", "cell": "cell.in", "model": "cauchy-born"}
    dump_case(make(only="continuum", continuum__material=material), folder / "case.yaml")
    found = msgspec.json.decode(probe(folder / "case.yaml").stdout)["material"]
    crystal = msgspec.convert(found, PairLattice)
    assert crystal.density * crystal.area == pytest.approx(1.0, rel=1e-14)
    assert crystal.shear == pytest.approx(27.833155, rel=1e-7)
    assert len(crystal.bonds) == len(crystal.energy) == 9
    assert crystal.stretch_limit == 0.12


def test_probe_finds_the_energy_of_a_crystal_not_known_as_bound_in_pairs(
    folder: Path, make: Callable[..., Case]
) -> None:
    text = (folder / "cell.in").read_text()
    for old, new in (
        ("pair_style lj/cut ${cutoff}", "pair_style hybrid/scaled 1.0 lj/cut ${cutoff}"),
        ("pair_coeff 1 1 ${epsilon}", "pair_coeff 1 1 lj/cut ${epsilon}"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "cell.in").write_text(text)
    material = {"from": "md", "cell": "cell.in", "model": "cauchy-born"}
    dump_case(make(only="continuum", continuum__material=material), folder / "case.yaml")
    found = msgspec.json.decode(probe(folder / "case.yaml").stdout)["material"]
    crystal = msgspec.convert(found, Hyperelastic)
    assert crystal.density == pytest.approx(0.9317984, rel=1e-6)
    assert crystal.shear == pytest.approx(27.8332, rel=1e-5)
    # the first coefficient is C11 / 2
    assert crystal.coefficients[0] == pytest.approx(83.4995 / 2, rel=1e-3)
    assert crystal.strain_limit == 0.06


@pytest.mark.parametrize(
    "asked",
    [{"model": "linear"}, {"model": "cauchy-born", "degree": 3}, {"model": "lattice-sum"}],
)
def test_every_model_in_space_has_the_stiffness_and_the_thermal_stress(
    asked: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the linear one; what vibrations do is measured elsewhere."""
    monkeypatch.setattr(module.vibrations, "thermal_stress", lambda cell: np.arange(6.0))
    write_scripts(tmp_path)
    material = MeasuredByMd(cell=str(tmp_path / "cell.in"), **asked)
    found = module.measure(material, "metal", 3, MPI.COMM_SELF, tmp_path / "log", warm=True)
    assert not isinstance(found, Elastic | PairLattice | J2)
    assert found.thermal_stress == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    C = stiffness(found, 3)
    assert C[0, 0] == pytest.approx(1.699e6, rel=1e-3)
    with open_cell(material.cell, "metal", MPI.COMM_SELF, tmp_path / "log", (3,)) as cell:
        np.testing.assert_array_equal(C, measure_all(cell).stiffness)


def test_probe_of_md_alone_fills_the_domain() -> None:
    done = probe(EXAMPLE / "case.yaml", "--only", "md")
    assert json.loads(done.stdout)["atoms"] == 206856


def test_probe_leaves_nothing_behind() -> None:
    before = sorted(EXAMPLE.iterdir())
    probe(EXAMPLE / "case.yaml")
    assert sorted(EXAMPLE.iterdir()) == before


def test_probe_of_given_moduli_measures_none(folder: Path, make: Callable[..., Case]) -> None:
    dump_case(make(), folder / "case.yaml")
    found = json.loads(probe(folder / "case.yaml").stdout)
    assert found["material"] is None
    assert found["spacing"] == pytest.approx(1.0731935**0.5, rel=1e-6)


def test_probe_tells_lammps_words_and_exits_with_2(folder: Path, make: Callable[..., Case]) -> None:
    (folder / "block.in").write_text("units lj\npair_style none_such\n")
    dump_case(make(), folder / "case.yaml")
    done = probe(folder / "case.yaml")
    assert done.returncode == 2
    assert done.stdout == ""
    assert re.search(r"block.in: .*none_such", done.stderr)
    missing = probe(folder / "none.yaml")
    assert missing.returncode == 2
    assert "none.yaml" in missing.stderr


# --- other MD codes ------------------------------------------------------------------------


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The toy, as if it were installed."""
    monkeypatch.setattr(module, "load_code", lambda role, name: ToyAtoms)


def test_another_code_tells_number_mass_cutoff_and_spacing(
    toy: None, make: Callable[..., Case]
) -> None:
    found = module.probe(make(md__backend="toy", coupling__zones={"outer": 2.6}), MPI.COMM_SELF)
    assert found.atoms == found.mass > 500
    assert found.cutoff == ToyAtoms.cutoff
    assert found.spacing == pytest.approx((A**2 * 3**0.5 / 2) ** 0.5, rel=1e-6)
    assert found.material is found.crystal is found.planes is None


def test_another_code_measures_no_material_and_finds_no_crystal(
    toy: None, make: Callable[..., Case]
) -> None:
    measured = {"from": "md", "cell": "cell.in"}
    with pytest.raises(BackendError, match=r"continuum.material: only LAMMPS measures .* toy give"):
        module.probe(make(md__backend="toy", continuum__material=measured), MPI.COMM_SELF)
    with pytest.raises(BackendError, match=r"coupling.planes: only LAMMPS finds them"):
        module.probe(make(md__backend="toy", coupling__scheme="force"), MPI.COMM_SELF)


def _with_after(folder: Path, make: Callable[..., Case], text: str) -> None:
    (folder / "after.in").write_text(text)
    dump_case(make(only="md", md__after="after.in"), folder / "case.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fix hot gimpmd_free langevinn 1 1 1 1\n", "langevinn"),
        ("fix 1 all nve\n", "after.in: fix 1 (nve) integrates the motion"),
        ("fix 1 gimpmd_free setforce v_none 0 0\n", "after.in: "),
    ],
)
def test_probe_reads_the_script_after(
    folder: Path, make: Callable[..., Case], text: str, words: str
) -> None:
    """The last one fails only when LAMMPS gets ready to run."""
    _with_after(folder, make, text)
    done = probe(folder / "case.yaml")
    assert done.returncode == 2
    assert words in done.stderr


def test_probe_accepts_fixes_on_the_groups_of_gimpmd(
    folder: Path, make: Callable[..., Case]
) -> None:
    groups = ("free", "boundary", "surface")
    lines = [f"fix {name} gimpmd_{name} setforce 0 NULL NULL" for name in groups]
    _with_after(folder, make, "\n".join([*lines, "velocity gimpmd_free create 1.0 12345"]))
    done = probe(folder / "case.yaml")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["atoms"] > 0
