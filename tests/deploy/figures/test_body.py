"""Outlines of a body and of its zones."""

import msgspec
import pytest

from gimpmd_deploy.figures.body import outline, zone_outlines
from gimpmd_deploy.figures.style import pyplot
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.grid.zones import MdRegion, Zones
from tests.cases import CASE

REGION = MdRegion(((0.0, 60.0), (0.0, 80.0)), ((False, True), (False, False)))


def test_edges_of_zones():
    zones = Zones((REGION,), outer=4.0, incommunicado=2.0, inner=12.0, filter=8.0)
    found = dict(zone_outlines("velocity", zones, REGION))
    assert {name: box[0] for name, box in found.items()} == {
        "outer": (0.0, 56.0),
        "incommunicado": (0.0, 54.0),
        "inner": (0.0, 42.0),
    }
    assert [name for name, _ in zone_outlines("force", zones, REGION)] == ["ghost"]


@pytest.mark.parametrize("dim", [2, 3])
def test_zones_of_any_dimension(dim):
    box = ((0.0, 60.0), (0.0, 80.0), (0.0, 50.0))[:dim]
    region = MdRegion(box, ((False, True), (True, False), (True, True))[:dim])
    zones = Zones((region,), outer=4.0, incommunicado=2.0, inner=12.0, filter=8.0)
    [*_, (_, inner)] = zone_outlines("velocity", zones, region)
    assert inner == ((0.0, 42.0), (18.0, 80.0), (18.0, 32.0))[:dim]


def test_a_line_for_each_zone_of_each_interface():
    figure, axes = pyplot().subplots()
    outline(axes, make_plan(msgspec.convert(CASE, Case)))
    assert [list(line.get_xdata()) for line in axes.lines] == [[56.0] * 2, [56.0] * 2, [42.0] * 2]
    pyplot().close(figure)
