"""What a case says of itself: steps, patches, zones, wave speeds, digest."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case import Case, Face
from gimpmd_schemas.zones import patches

Make = Callable[..., Case]


@pytest.mark.parametrize(
    ("end", "expected"), [(8, 100), (8.0001, 101), (0.079, 1), (0.08, 1), (0.0801, 2), (0.24, 3)]
)
def test_the_last_step_reaches_or_passes_the_end(make: Make, end: float, expected: int) -> None:
    case = make(time__end=end)
    assert case.steps() == expected
    assert case.steps() * case.step() >= end * (1 - 1e-9)
    assert (case.steps() - 1) * case.step() < end


def test_temporal_factor_of_the_paper(make: Make) -> None:
    """Ma et al. section 5.1: L = 4, dt = 0.002; Eq. 17 with the 2D modulus of their lattice."""
    case = make(
        time__md_steps="auto",
        continuum__material={"from": "case", "density": 0.9165, "lame": 24.745, "shear": 24.745},
    )
    speed = math.sqrt(65.987 / 0.9165)  # sqrt(E / rho) of PHYSICS: E = 65.987
    assert case.wave_speed("bar") == pytest.approx(speed, rel=1e-4)
    assert case.md_steps() == round(0.1 * 4 / speed / 0.002)


def test_wave_speeds_are_those_of_the_lattice(make: Make) -> None:
    case = make(
        continuum__material={
            "from": "case", "density": 0.9317984, "lame": 27.8332, "shear": 27.8332,
        }
    )  # fmt: skip
    assert case.wave_speed("P") == pytest.approx(9.4663, abs=1e-4)
    assert case.wave_speed("S") == pytest.approx(5.4654, abs=1e-4)


def test_wave_speed_needs_the_moduli(make: Make) -> None:
    case = make(continuum__material={"from": "md", "cell": "cell.in"})
    with pytest.raises(ValueError, match="not been measured"):
        case.wave_speed("P")


@given(st.integers(1, 64), st.floats(0.1, 10))
def test_automatic_patches_use_every_rank(make: Make, ranks: int, aspect: float) -> None:
    case = make(md__ranks=ranks, md__region=[[0, 80 * aspect], [20, 60]])
    px, py = case.md_patches()
    assert px * py == ranks
    assert len(patches(case.md_region(), (px, py))) == ranks


def test_automatic_patches_are_squarish(make: Make) -> None:
    assert make(md__ranks=2).md_patches() == (2, 1)
    assert make(md__ranks=8).md_patches() == (4, 2)
    assert make(md__ranks=8, md__patches=[8, 1]).md_patches() == (8, 1)


def test_interfaces_are_the_faces_inside_the_body(make: Make) -> None:
    assert make().zones().interfaces == ((False, True), (True, True))
    strip = make(domain__periodic=[False, True], md__region=[[0, 80], [0, 80]])
    assert strip.zones().interfaces == ((False, True), (False, False))
    alone = make(only="md")
    assert alone.zones().interfaces == ((False, False), (False, False))
    assert alone.zones().region == alone.domain.box
    assert alone.roles() == ("md",)
    assert make().roles() == ("md", "continuum")


def test_default_zones(make: Make) -> None:
    zones = make().zones()  # cell 4, layers of 2
    assert (zones.outer, zones.incommunicado, zones.inner, zones.filter) == (4.0, 2.0, 12.0, 8.0)
    zones = make(coupling__zones={"outer": 5, "incommunicado": 0}).zones()
    assert (zones.outer, zones.incommunicado, zones.inner, zones.filter) == (5.0, 0.0, 12.0, 8.0)


def test_background_grid_covers_the_domain(make: Make) -> None:
    grid = make(domain__periodic=[False, True]).background_grid()
    assert (grid.origin, grid.cell, grid.cells) == ((0.0, 0.0), 4.0, (30, 20))
    assert grid.periodic == (False, True)


@pytest.mark.parametrize(
    ("ramp", "time", "factor"), [(0, 0, 1), (10, 0, 0), (10, 5, 0.5), (10, 10, 1), (10, 99, 1)]
)
def test_ramp(ramp: float, time: float, factor: float) -> None:
    assert Face(condition="traction", value=(0.0, 1.0), ramp=ramp).factor(time) == factor


def test_faces_by_axis_and_side(make: Make) -> None:
    case = make(boundary={name: {"ramp": i} for i, name in enumerate(("left", "right", "bottom"))})
    assert [case.boundary.face(a, s).ramp for a in (0, 1) for s in (0, 1)] == [0, 1, 2, 0]


def test_digest_tells_cases_apart_and_ignores_the_order_of_keys(make: Make) -> None:
    case = make(md__variables={"a": 1.0, "b": 2.0})
    assert case.digest() == make(md__variables={"b": 2.0, "a": 1.0}).digest()
    assert case.digest() != make(md__variables={"a": 1.0, "b": 2.5}).digest()
    assert msgspec.convert(msgspec.to_builtins(case), Case).digest() == case.digest()


def test_output_interval_in_steps(make: Make) -> None:
    assert make(output__interval=1).output_every() == 12  # 12.5 steps of 0.08
    assert make(output__interval=0.01).output_every() == 1
