"""A verification of an interface: what it refuses, and whole runs of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from gimpmd_deploy.verify import interface
from gimpmd_schemas.wire.answers import Repeat
from tests.copper_sites import TRANSMITTED, H, copper_case, write_scripts
from tests.deploy.verify.crystal import BULK, IN_SPACE, MEASURED


def test_without_a_cell_it_says_what_to_write(bench, no_services) -> None:
    result = bench.gimpmd("verify", "interface", bench.write())
    assert result.exit_code == 2
    assert "continuum.material" in result.stderr
    assert "{from: md, cell: bulk.in}" in result.stderr


@pytest.mark.parametrize("words", ["8,2", "nan"])
def test_wavelengths_must_be_numbers_of_cells(bench, no_services, words: str) -> None:
    path = bench.write({"continuum.material": MEASURED})
    (path.parent / "bulk.in").write_text(BULK)
    result = bench.gimpmd("verify", "interface", path, "--wavelengths", words)
    assert result.exit_code == 2
    assert "--wavelengths" in result.stderr


def test_a_case_of_one_side_has_nothing_to_verify(bench, no_services) -> None:
    path = bench.write({"continuum.material": MEASURED, "only": "md"})
    (path.parent / "bulk.in").write_text(BULK)
    result = bench.gimpmd("verify", "interface", path)
    assert result.exit_code == 2
    assert "nothing to couple" in result.stderr


@pytest.mark.long
def test_a_whole_verification(bench) -> None:
    """One short wave on strips along y, whose interface lies across the close-packed rows."""
    path = bench.write(
        {
            "continuum.material": MEASURED,
            "time.md_steps": 10,
            "time.md_timestep": 0.008,
        }
    )
    (path.parent / "bulk.in").write_text(BULK)
    words = ("--wavelengths", "8", "--quick", "--axis", "y", "--jobs", "2", "--out", "there")
    result = bench.gimpmd("verify", "interface", path, *words, "--json")
    assert result.exit_code == 0, result.stderr
    verdict = json.loads(result.stdout)
    assert verdict == json.loads(Path("there/interface.json").read_text())
    assert Path("there/interface.png").stat().st_size > 1000
    assert (verdict["scheme"], verdict["md_steps"], verdict["axis"]) == ("velocity", 10, "y")
    shares = {
        (row["polarization"], row["travel"]): (row["reflected"], row["transmitted"])
        for row in verdict["rows"]
    }
    grid = verdict["rows"][0]
    # nothing is required of T into the atoms at 8 h: it depends on where rows lie in the cells
    reflected, transmitted = shares["P", "into"]
    assert reflected == pytest.approx(grid["grid_reflected"], abs=0.01)
    assert transmitted == pytest.approx(1.0, abs=0.2)
    reflected, transmitted = shares["P", "out"]
    assert reflected < grid["grid_reflected"] + 0.003
    assert transmitted > 0.65
    assert verdict["shortest"] is None
    assert not list(Path("there/strips/P-8h-into/run/figures").iterdir())
    assert "a name that gimpmd uses too" in Path("there/strips/P-8h-into/bulk.in").read_text()
    assert grid["grid_reflected"] + grid["grid_transmitted"] == pytest.approx(1.0, abs=0.01)
    assert np.isfinite(list(shares.values())).all()


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_whole_verification_of_the_force_scheme(bench) -> None:
    """P and S, straight and oblique, beside the grid alone and the atoms alone."""
    crystal = {"from": "md", "model": "cauchy-born", "cell": "bulk.in"}
    path = bench.write({"continuum.material": crystal, "coupling.scheme": "force"})
    (path.parent / "bulk.in").write_text(BULK)
    words = ("--wavelengths", "8,12", "--jobs", "2", "--out", "there", "--json")
    result = bench.gimpmd("verify", "interface", path, *words)
    assert result.exit_code == 0, result.stderr
    verdict = json.loads(result.stdout)
    assert (verdict["scheme"], verdict["shortest"]) == ("force", 12.0)
    assert {row["degrees"] > 0.0 for row in verdict["rows"]} == {False, True}
    for row in verdict["rows"]:
        assert row["md_transmitted"] == pytest.approx(1.0, abs=0.01)
        if row["degrees"] and row["wavelength"] < 12.0:
            continue  # nothing is required there; P at 30 degrees reflects .011 more than the grid
        assert row["reflected"] <= row["grid_reflected"] + 0.004
        assert row["transmitted"] >= row["grid_transmitted"] - 0.005


def test_a_body_of_two_dimensions_has_no_z_axis(bench, no_services) -> None:
    path = bench.write({"continuum.material": MEASURED})
    (path.parent / "bulk.in").write_text(BULK)
    result = bench.gimpmd("verify", "interface", path, "--axis", "z")
    assert result.exit_code == 2
    assert "is no axis of a body of two dimensions" in result.stderr


def test_a_crystal_that_fits_no_cells_is_refused(bench, monkeypatch) -> None:
    """Periods across x without a common multiple, and no interface along the other axes."""
    repeat = Repeat(low=(0.0,) * 3, size=(1.0, 1.3, 1.3 * 2**0.5), period=(1.0, 1.3, 1.3 * 2**0.5))
    monkeypatch.setattr(interface, "ask_repeat", lambda *_: repeat)
    monkeypatch.setattr(interface, "ask_lammps", lambda *_: None)
    monkeypatch.setattr(interface, "fill_in", lambda case, *_: case)
    path = bench.write(IN_SPACE | {"continuum.material": MEASURED})
    (path.parent / "bulk.in").write_text(BULK)
    result = bench.gimpmd("verify", "interface", path)
    assert result.exit_code == 2
    assert "periods of 1, 1.3, 1.83848" in result.stderr
    assert "try --axis" in result.stderr


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_whole_verification_in_space(bench) -> None:
    """Copper by embedded atoms: P and S waves of eight cells, both ways.

    The plane leaves an eighth of its cell to the continuum, so more comes back than from others.
    """
    case = copper_case((8, 2, 2), ((2.3, 8), None, None), 0.032)
    write_scripts(bench.folder)
    (bench.folder / "case.yaml").write_text(yaml.safe_dump(case))
    words = ("--quick", "--jobs", "2", "--out", "there", "--json")
    result = bench.gimpmd("verify", "interface", bench.folder / "case.yaml", *words)
    assert result.exit_code == 0, result.stderr
    verdict = json.loads(result.stdout)
    assert (verdict["scheme"], verdict["axis"], verdict["shortest"]) == ("sites", "x", 8.0)
    assert verdict["cell"] == pytest.approx(H)
    rows = verdict["rows"]
    assert len(rows) == 4
    for row in rows:
        if row["travel"] == "out":
            assert row["reflected"] < 0.008
            assert TRANSMITTED[0] < row["transmitted"] < TRANSMITTED[1]
