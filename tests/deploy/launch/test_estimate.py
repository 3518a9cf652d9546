"""What a case will cost: counts that can be made by hand, with levels and in three dimensions."""

import json

import msgspec
import numpy as np
import pytest

from gimpmd_deploy.cli import app
from gimpmd_deploy.launch.estimate import estimate
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import Probe
from tests.deploy.conftest import CASE, REMOVE, changed

ALONE = {"only": "continuum", "md": REMOVE, "time": {"end": 1}}


def case(changes):
    return msgspec.convert(changed(CASE, changes), Case)


def test_one_level():
    cost = estimate(case({}), Probe(atoms=5000))
    (level,) = cost.levels
    assert (level.cell, level.cells, level.nodes) == (4.0, 30 * 20, 31 * 21)
    assert level.step == cost.step == pytest.approx(0.08)
    # 60 x 40 sites, less those deeper than 4 + 2 + 12: [0, 42] of [0, 60]
    assert cost.points == level.points == 60 * 40 - 21 * 40
    assert cost.steps == 10
    assert cost.md_steps == 40


@pytest.mark.parametrize("per_cell", [1, 2, 3])
def test_points_of_a_coupled_case_are_those_above_the_innermost_depth(per_cell):
    coupled = case({"md.region": [[20, 100], [16, 80]], "grid.points_per_axis": per_cell})
    edge = 4.0 / per_cell
    axes = [edge * (np.arange(n * per_cell) + 0.5) for n in (30, 20)]
    sites = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    zones = coupled.zones()
    assert estimate(coupled, None).points == (zones.depth(sites) < zones.innermost).sum()


def test_points_around_several_regions():
    boxes = [[[0, 42], [0, 80]], [[78, 118], [20, 60]]]
    coupled = case({"md.region": REMOVE, "md.regions": boxes})
    # depth 18: 12 x 40 sites of points 2 wide in the first, 2 x 2 in the second
    assert estimate(coupled, None).points == 60 * 40 - 12 * 40 - 2 * 2


def test_levels():
    refined = [
        {"boxes": [[[16, 48], [16, 48]], [[64, 96], [16, 48]]]},
        {"boxes": [[[24, 40], [24, 40]]]},
    ]
    cost = estimate(case(ALONE | {"grid.levels": refined}), None)
    coarse, middle, fine = cost.levels
    assert (coarse.cells, middle.cells, fine.cells) == (600, 2 * 16**2, 16**2)
    assert (coarse.nodes, middle.nodes, fine.nodes) == (31 * 21, 2 * 17**2, 17**2)
    # a point is on the finest level that covers it: 600 - 2 x 64, 512 - 64, 256 cells of four
    assert [level.points for level in cost.levels] == [4 * 472, 4 * 448, 4 * 256]
    assert cost.points == 4 * (472 + 448 + 256)
    assert [level.step / fine.step for level in cost.levels] == [4, 2, 1]
    assert cost.cfl == pytest.approx(0.4)
    assert cost.md_steps is None
    # the time is that of 118 x 4 + 224 x 4 + 256 x 4 points in each step of the finest
    uniform = estimate(case(ALONE | {"grid.cell": 1.0}), None)
    share = 4 * (472 / 4 + 448 / 2 + 256) / uniform.points
    assert cost.seconds / uniform.seconds == pytest.approx(share)
    assert cost.memory < uniform.memory


def test_levels_of_a_coupled_case():
    cost = estimate(case({"grid.levels": [{"boxes": [[[0, 72], [0, 80]]]}]}), None)
    # level 1: 72 x 80 sites less those deeper than 2 + 1 + 6: [0, 51] of [0, 60]
    assert [level.points for level in cost.levels] == [4 * 12 * 20, 72 * 80 - 51 * 80]
    assert [level.step for level in cost.levels] == [pytest.approx(0.16), pytest.approx(0.08)]


def test_three_dimensions():
    block = ALONE | {"domain.box": [[0, 40], [0, 32], [0, 24]], "boundary": {}}
    cost = estimate(case(block), None)
    assert (cost.points, cost.nodes) == (8 * 10 * 8 * 6, 11 * 9 * 7)


def test_what_is_not_measured_is_not_known():
    material = {"continuum.material": {"from": "md", "cell": "bulk.in"}}
    assert estimate(case(ALONE | material), None).step is None
    assert estimate(case(material), None).step == pytest.approx(0.08)
    own = estimate(case(ALONE | material | {"time": {"end": 1, "step": 0.1}}), None)
    assert (own.step, own.steps, own.cfl) == (0.1, 10, None)


def test_validate_shows_the_levels(bench):
    path = bench.write(ALONE | {"grid.levels": [{"boxes": [[[16, 48], [16, 48]]]}]})
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


@pytest.mark.parametrize(
    "changes",
    [
        {"grid.levels": [{"boxes": [[[0, 72], [0, 80]]]}]},
        ALONE | {"domain.box": [[0, 40], [0, 32], [0, 24]], "boundary": {}},
    ],
    ids=["levels", "three dimensions"],
)
def test_set_up_is_drawn(bench, changes):
    picture = bench.folder / "setup.png"
    result = bench.gimpmd("validate", bench.write(changes), "--picture", picture)
    assert result.exit_code == 0, result.output
    assert picture.stat().st_size > 10_000


def test_gimp_is_started_on_its_ranks(bench):
    parallel = case({"continuum.ranks": 2})
    _, others = app._services(parallel, bench.folder)
    gimp = next(service for service in others("tcp/x") if service.name == "gimp")
    assert gimp.argv[1:3] == ["-n", "2"]
    _, others = app._services(case({}), bench.folder)
    gimp = next(service for service in others("tcp/x") if service.name == "gimp")
    assert "-n" not in gimp.argv
