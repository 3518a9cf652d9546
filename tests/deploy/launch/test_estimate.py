"""What a case will cost: counts that can be made by hand, with levels and in three dimensions."""

import msgspec
import numpy as np
import pytest

from gimpmd_deploy.launch.estimate import estimate
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import CorrectionSize, Probe
from tests.cases import BLOCK_3D, CASE, CONTINUUM_ONLY, REMOVE, changed


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
    zones = zones_of(coupled)
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
    cost = estimate(case(CONTINUUM_ONLY | {"grid.levels": refined}), None)
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
    uniform = estimate(case(CONTINUUM_ONLY | {"grid.cell": 1.0}), None)
    share = 4 * (472 / 4 + 448 / 2 + 256) / uniform.points
    assert cost.seconds / uniform.seconds == pytest.approx(share)
    assert cost.memory < uniform.memory


def test_levels_of_a_coupled_case():
    cost = estimate(case({"grid.levels": [{"boxes": [[[0, 72], [0, 80]]]}]}), None)
    # level 1: 72 x 80 sites less those deeper than 2 + 1 + 6: [0, 51] of [0, 60]
    assert [level.points for level in cost.levels] == [4 * 12 * 20, 72 * 80 - 51 * 80]
    assert [level.step for level in cost.levels] == [pytest.approx(0.16), pytest.approx(0.08)]


def test_three_dimensions():
    cost = estimate(case(BLOCK_3D), None)
    assert (cost.points, cost.nodes) == (8 * 10 * 8 * 6, 11 * 9 * 7)


def test_what_is_not_measured_is_not_known():
    material = {"continuum.material": {"from": "md", "cell": "bulk.in"}}
    assert estimate(case(CONTINUUM_ONLY | material), None).step is None
    assert estimate(case(material), None).step == pytest.approx(0.08)
    own = estimate(case(CONTINUUM_ONLY | material | {"time": {"end": 1, "step": 0.1}}), None)
    assert (own.step, own.steps, own.cfl) == (0.1, 10, None)


def test_every_rank_of_the_continuum_finds_the_whole_correction():
    size = CorrectionSize(equations=600, memory=10**9)
    coupled = case({"continuum.ranks": 3})
    cost, without = estimate(coupled, None, size), estimate(coupled, None)
    assert cost.correction == size
    assert without.correction is None
    assert cost.memory - without.memory == 3 * 10**9
