"""``gimpmd verify interface``: how strips are cut, what is judged, and a short whole run."""

from __future__ import annotations

import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gimpmd_deploy.verify.strips import MISFIT, Ground, Wave
from gimpmd_deploy.verify.verify import Row, Task, is_faithful, judge, plan, shortest_faithful
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import Repeat
from tests.deploy.conftest import CASE, changed

A = 1.1132013035564605
BULK = """\
units lj
dimension 2
boundary p p p
atom_style atomic
variable xlo equal 7 # a name that gimpmd uses too
variable a equal 1.1132013035564605
variable density equal 2/(sqrt(3)*v_a^2)
lattice hex ${density}
region cell block 0 3 0 2 -0.5 0.5
create_box 1 cell
create_atoms 1 region cell
mass 1 1
pair_style lj/cut 2.5
pair_coeff 1 1 1 1
"""
MEASURED = {"from": "md", "cell": "bulk.in"}


def ground(period: tuple[float, float], axis: int = 0, **changes: object) -> Ground:
    case = msgspec.convert(changed(CASE, {"continuum.threads": 1, **changes}), Case)
    low = (-1.5, 2.0)
    repeat = Repeat(low=low, size=(3 * period[0], 2 * period[1]), period=period)
    return Ground.of(case, "bulk.in", repeat, 0 if axis == 0 else 1)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("period", [(A, math.sqrt(3) * A), (3.0, 3.9), (9.1, 17.3), (2.0, 4.0)])
def test_strips_repeat_with_cells_hardly_smaller_than_the_cases(
    period: tuple[float, float], axis: int
) -> None:
    cut = ground(period, axis)
    assert (1 - MISFIT) * 4.0 <= cut.cell <= 4.0
    periods = cut.across * cut.cell / period[1 - axis]
    assert periods == pytest.approx(round(periods), abs=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("travel", ["into", "out"])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_strips_are_sound_cases(axis: int, travel: str, degrees: float) -> None:
    cut = ground((A, math.sqrt(3) * A), axis)
    wave = Wave(8.0, "S") if not degrees else cut.oblique(8.0, "S", degrees)
    case = cut.strip(wave, "into" if travel == "into" else "out")
    assert check_case(case) == []
    (start, end), packet = case.domain.box[axis], case.initial.packets[0]
    interface = case.atoms.region[axis][0]
    # the packet starts and ends wholly on one side: 2.5 wavelengths hold it
    far = abs(packet.center - interface)
    assert far == pytest.approx(2.5 * 8.0 * cut.cell)
    assert min(interface - start, end - interface) >= 2.0 * far
    way = case.time.end * case.wave_speed("S") * math.cos(math.radians(wave.degrees))
    assert way >= 2.0 * far
    # what is across repeats: whole periods of crystal, one wave
    low, high = case.domain.box[1 - axis]
    assert (high - low) / cut.crystal.period[1 - axis] == pytest.approx(
        round((high - low) / cut.crystal.period[1 - axis]), abs=1e-9
    )
    if degrees:
        assert 25.0 < wave.degrees < 35.0
        waves = (high - low) * math.sin(math.radians(packet.tilt)) / packet.wavelength
        assert waves == pytest.approx(1.0)


def test_strips_of_a_warm_case_are_cold() -> None:
    """Thermal stress would set them in motion, and noise is larger than any packet."""
    bath = {"rate": 2.0, "width": 8.0, "temperature": 0.05}
    warm = {"continuum.temperature": 0.05, "coupling.scheme": "force", "coupling.absorber": bath}
    case = ground((A, math.sqrt(3) * A), **warm).strip(Wave(8.0), "out")
    assert case.continuum.temperature is None
    assert case.coupling.absorber is not None
    assert (case.coupling.absorber.rate, case.coupling.absorber.temperature) == (2.0, 0.0)


def test_a_long_oblique_wave_stays_below_grazing() -> None:
    cut = ground((A, math.sqrt(3) * A))
    for degrees in (5.0, 30.0, 60.0, 89.0):
        wave = cut.oblique(3.0, "P", degrees)
        assert 0.0 < wave.degrees < 90.0


def test_all_strips_of_a_plan() -> None:
    cut = ground((A, math.sqrt(3) * A))
    quick = plan(cut, (8.0, 20.0), quick=True)
    assert len(quick) == 2 * 2 * 3
    assert {task.only for task in quick} == {None, "continuum"}
    assert quick[0].wave.wavelength == 20.0
    whole = plan(cut, (8.0, 20.0), quick=False)
    assert len(whole) == 3 * 2 * 4
    assert len({task.name for task in whole}) == len(whole)
    assert {task.wave.wavelength for task in whole if task.wave.degrees} == {8.0}


def test_the_criterion() -> None:
    assert is_faithful(0.03, 0.971, 0.021)
    assert not is_faithful(0.032, 1.0, 0.021)
    assert not is_faithful(0.0, 0.969, 0.0)
    assert not is_faithful(0.0, 1.031, 0.0)


def rows(faithful: dict[float, bool]) -> list[Row]:
    made = []
    for length, good in faithful.items():
        for travel, T in (("into", 1.0), ("out", 1.0 if good else 0.8)):
            made.append(
                Row(
                    wavelength=length,
                    polarization="P",
                    degrees=0.0,
                    travel="into" if travel == "into" else "out",
                    reflected=0.0,
                    transmitted=T,
                    grid_reflected=0.0,
                    grid_transmitted=1.0,
                    md_reflected=None,
                    md_transmitted=None,
                    faithful=is_faithful(0.0, T, 0.0),
                )
            )
    return made


@pytest.mark.parametrize(
    ("faithful", "shortest"),
    [
        ({6.0: False, 8.0: True, 20.0: True}, 8.0),
        ({6.0: True, 8.0: False, 20.0: True}, 20.0),
        ({6.0: True, 8.0: True, 20.0: False}, None),
        ({6.0: True}, 6.0),
    ],
)
def test_the_shortest_faithful_wavelength(
    faithful: dict[float, bool], shortest: float | None
) -> None:
    assert shortest_faithful(rows(faithful)) == shortest


def test_the_judgement_sets_each_wave_beside_the_grid() -> None:
    cut = ground((A, math.sqrt(3) * A))
    wave = Wave(8.0, "P")
    shares = {
        Task(wave, "into"): (0.02, 1.0),
        Task(wave, "out"): (0.0, 0.7),
        Task(wave, "into", "continuum"): (0.02, 0.98),
    }
    verdict = judge(cut, shares)
    assert [(row.travel, row.faithful) for row in verdict.rows] == [("into", True), ("out", False)]
    assert verdict.shortest is None
    assert (verdict.cell, verdict.case_cell) == (cut.cell, 4.0)


def test_without_a_cell_it_says_what_to_write(bench, no_services) -> None:
    result = bench.gimpmd("verify", "interface", bench.write())
    assert result.exit_code == 2
    assert "continuum.material" in result.stderr
    assert "{from: md, cell: bulk.in}" in result.stderr


@pytest.mark.parametrize("words", ["", "eight", "8,2", "8,,12", "nan"])
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
