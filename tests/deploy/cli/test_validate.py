"""``gimpmd validate``: cost and set-up of a case that does not run."""

import json
import re

import pytest
from PIL import Image

from gimpmd_deploy.cli import validate
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.wire.answers import CorrectionSize
from tests.cases import CONTINUUM_ONLY
from tests.services.gimp.fem.meshes import around
from tests.sites_case import SCRIPT, sites_case


def test_validate(bench):
    path = bench.write()
    result = bench.gimpmd("validate", path, "--picture", "setup.png", "--json")
    assert result.exit_code == 0, result.output
    cost = json.loads(result.stdout)
    assert cost["points"] == 1560
    assert cost["atoms"] is None
    assert cost["steps"] == 10
    speed = ((27.83 + 2 * 27.83) / 0.9318) ** 0.5
    assert cost["cfl"] == pytest.approx(speed * 0.08 / 4)
    with Image.open("setup.png") as image:
        assert image.size[0] > 500
    assert not bench.runs.exists()


def test_validate_asks_lammps(bench):
    result = bench.gimpmd("validate", bench.write(), "--probe")
    assert result.exit_code == 0, result.output
    atoms = int(re.search(r"atoms\s+([\d,]+)", result.stdout)[1].replace(",", ""))
    assert atoms == pytest.approx(60 * 80 / 1.0731935, rel=0.02)


def test_validate_shows_the_levels(bench):
    path = bench.write(CONTINUUM_ONLY | {"grid.levels": [{"boxes": [[[16, 48], [16, 48]]]}]})
    result = bench.gimpmd("validate", path)
    assert result.exit_code == 0, result.output
    lines = {line[:17].strip(): line for line in result.stdout.splitlines()}
    for words in ("600 cells of 4 sigma", "2,144 points", "step 0.169 tau"):  # 0.4 h over 9.466
        assert words in lines["level 0"]
    for words in ("256 cells of 2 sigma", "1,024 points", "step 0.08452 tau"):
        assert words in lines["level 1"]
    assert "3,168" in lines["material points"]
    answer = json.loads(bench.gimpmd("validate", path, "--json").stdout)
    assert [level["points"] for level in answer["levels"]] == [2144, 1024]


def test_validate_reads_the_mesh(bench):
    mesh = {"continuum.backend": "fem", "continuum.mesh": "m.vtu", "time.step": 0.1}
    path = bench.write(CONTINUUM_ONLY | mesh)
    inner = (40.0, 80.0), (20.0, 60.0)
    around(path.parent / "m.vtu", ((0.0, 120.0), (0.0, 80.0)), inner, 4.0)
    result = bench.gimpmd("validate", path)
    assert result.exit_code == 0, result.output
    around(path.parent / "m.vtu", ((0.0, 120.0), (0.0, 76.0)), inner, 4.0)
    result = bench.gimpmd("validate", path)
    assert result.exit_code == 2
    assert "case.yaml: continuum.mesh = 'm.vtu': " in result.stderr


def test_a_picture_needs_a_folder(bench):
    result = bench.gimpmd("validate", bench.write(), "--picture", "none/setup.png")
    assert result.exit_code == 2
    assert "--picture: cannot write in none" in result.stderr


def test_validate_states_the_memory_of_a_correction(bench, monkeypatch):
    size = CorrectionSize(equations=55_728, memory=10**18)
    monkeypatch.setattr(validate, "ask_correction", lambda *_: size)
    result = bench.gimpmd("validate", bench.write())
    assert result.exit_code == 0, result.output
    assert re.search(r"correction +55,728 equations, about 1e\+09 GB in each", result.stdout)
    assert "warning: coupling.scheme: sites: the correction takes about 1e+09 GB" in result.stdout
    answer = json.loads(bench.gimpmd("validate", bench.write(), "--json").stdout)
    assert answer["correction"] == {"equations": 55_728, "memory": 10**18}


def test_validate_looks_at_the_modes(bench):
    dump_case(sites_case(), bench.folder / "case.yaml")
    (bench.folder / "plate.in").write_text(SCRIPT)
    result = bench.gimpmd("validate", bench.folder / "case.yaml", "--probe")
    assert result.exit_code == 0, result.output
    said = r"modes +all stable, the lowest has 2\.2e-03 of the largest stiffness \(664 freedoms, "
    assert re.search(said, result.stdout)
