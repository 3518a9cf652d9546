"""Interfaces and zones."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_schemas.case.derive import choices, zones
from gimpmd_schemas.case.form import Case

Make = Callable[..., Case]


def test_interfaces_are_the_faces_inside_the_body(make: Make) -> None:
    assert zones.zones(make()).regions[0].interfaces == ((False, True), (True, True))
    strip = make(domain__periodic=[False, True], md__region=[[0, 80], [0, 80]])
    assert zones.zones(strip).regions[0].interfaces == ((False, True), (False, False))
    alone = make(only="md")
    assert zones.zones(alone).regions[0].interfaces == ((False, False), (False, False))
    assert zones.zones(alone).regions[0].box == alone.domain.box
    assert alone.roles() == ("md",)
    assert make().roles() == ("md", "continuum")


def test_default_zones(make: Make) -> None:
    found = zones.zones(make())  # cell 4, layers of 2
    assert (found.outer, found.incommunicado, found.inner, found.filter) == (4.0, 0.0, 14.0, 8.0)
    found = zones.zones(make(coupling__zones={"outer": 5, "incommunicado": 2}))
    assert (found.outer, found.incommunicado, found.inner, found.filter) == (5.0, 2.0, 14.0, 8.0)


def test_the_scheme_as_published_has_four_layers_to_buffer_and_inner_zone(make: Make) -> None:
    found = zones.zones(make(coupling__scheme="paper"))
    assert (found.incommunicado, found.inner) == (8.0, 8.0)
    assert choices.filter_rate(make(coupling__scheme="paper")) == 0.0
