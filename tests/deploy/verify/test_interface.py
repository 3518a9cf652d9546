"""A verification of an interface: what it refuses, and whole runs of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.deploy.verify.crystal import BULK, MEASURED


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


def test_strips_have_two_dimensions(bench, no_services) -> None:
    changes = {"domain.box": [[0, 120], [0, 80], [0, 80]], "domain.periodic": [False, True, True]}
    changes |= {"md.region": [[0, 60], [0, 80], [0, 80]], "coupling": {"scheme": "sites"}}
    changes |= {"boundary": {}, "continuum.material": MEASURED}
    path = bench.write(changes)
    (path.parent / "bulk.in").write_text(BULK)
    result = bench.gimpmd("verify", "interface", path)
    assert result.exit_code == 2
    assert "strips can be cut in two only" in result.stderr
