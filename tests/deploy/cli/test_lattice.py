"""``gimpmd lattice``: what it prints, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from gimpmd_deploy.cli.app import app
from gimpmd_deploy.cli.lattice import elastic_constants, scales
from gimpmd_schemas.wire.lattice import Crystal
from tests.deploy.verify.crystal import BULK
from tests.schemas.wire.test_lattice import CRYSTAL

COPPER = ("--pair", "eam/alloy", "--file", "Cu_mishin1.eam.alloy", "--element", "Cu")
FCC = ("--crystal", "fcc", "--units", "metal")


def call(*words: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["lattice", *map(str, words)])
    return done.exit_code, done.stdout, done.stderr


def test_a_potential_in_si_units_of_the_field() -> None:
    code, out, _ = call(*COPPER, *FCC)
    assert code == 0
    text = " ".join(out.split())
    for words in (
        "lattice constant 3.61492",
        "elastic constants C11 = 169.877, C12 = 122.585, C44 = 76.2061 GPa",
        "density 8.93566 g/cm^3",
        "surface (111) 1239.5 mJ/m^2, as cut 1246.7",
        "waves along [100] 4360.2, 2920.3, 2920.3 m/s",
    ):
        assert words in text


def test_the_cell_of_a_script_as_json(tmp_path: Path) -> None:
    (tmp_path / "bulk.in").write_text(BULK)
    code, out, _ = call(tmp_path / "bulk.in", "--json")
    assert code == 0
    found = msgspec.convert(json.loads(out), Crystal)
    assert found.factors == pytest.approx((1.0, 1.0), rel=1e-8)
    assert found.neighbours == pytest.approx(1.1132013035564605)
    assert 2 * found.surfaces[1].relaxed == pytest.approx(2.182, abs=5e-4)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "--pair: is missing"),
        (("--pair", "sw", "--units", "metal"), "--crystal: is missing"),
        ((*COPPER, *FCC, "--coeff", "1 1"), "--coeff: is given in addition to --file"),
        (("cell.in", *COPPER), "CELL.in = 'cell.in': is given in addition to a potential"),
        (("nowhere.in",), "does not exist"),
        (("--pair", "eam/alloy", "--file", "no.eam", "--element", "Cu", *FCC), "no.eam"),
    ],
)
def test_bad_input_is_one_clear_error(words: tuple[str, ...], message: str) -> None:
    code, out, err = call(*words)
    assert code == 2
    assert out == ""
    assert message in err
    assert "Traceback" not in err


def test_constants_of_less_symmetric_crystals() -> None:
    assert dict(elastic_constants(CRYSTAL)) == {"C11": 3.0, "C12": 1.0, "C66": 1.0}
    other = msgspec.structs.replace(CRYSTAL, stiffness=((3, 1, 0.5), (1, 4, 0), (0.5, 0, 1)))
    names = ["C11", "C12", "C16", "C22", "C66"]
    assert [name for name, _ in elastic_constants(other)] == names


def test_units_of_the_table() -> None:
    assert scales(CRYSTAL).surface_unit == "epsilon/sigma"
    assert scales(CRYSTAL).modulus_unit == "epsilon/sigma^2"
    metal = scales(msgspec.structs.replace(CRYSTAL, units="metal", dimension=3))
    assert metal.modulus == pytest.approx(1e-4)  # bar to GPa
    assert metal.surface == pytest.approx(1e-2)  # bar A to mJ/m^2
    assert metal.speed == pytest.approx(100.0)  # A/ps to m/s
    assert metal.density == pytest.approx(1.66053907)  # g/mol/A^3 to g/cm^3
    real = scales(msgspec.structs.replace(CRYSTAL, units="real", dimension=3))
    assert real.speed == pytest.approx(1e5)  # A/fs to m/s
