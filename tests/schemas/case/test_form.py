"""What a case says of itself: steps, patches, zones, wave speeds, digest."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.form import Case, Face
from gimpmd_schemas.grid.zones import patches

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
        continuum__material={"from": "moduli", "density": 0.9165, "lame": 24.745, "shear": 24.745},
    )
    speed = math.sqrt(65.987 / 0.9165)  # sqrt(E / rho) of PHYSICS: E = 65.987
    assert case.wave_speed("bar") == pytest.approx(speed, rel=1e-4)
    assert case.md_steps() == round(0.1 * 4 / speed / 0.002)


def test_wave_speeds_are_those_of_the_lattice(make: Make) -> None:
    case = make(
        continuum__material={
            "from": "moduli", "density": 0.9317984, "lame": 27.8332, "shear": 27.8332,
        }
    )  # fmt: skip
    assert case.wave_speed("P") == pytest.approx(9.4663, abs=1e-4)
    assert case.wave_speed("S") == pytest.approx(5.4654, abs=1e-4)


def test_wave_speed_needs_the_moduli(make: Make) -> None:
    case = make(continuum__material={"from": "md", "cell": "cell.in"})
    with pytest.raises(ValueError, match="not been measured"):
        case.wave_speed("P")


def test_wave_speeds_of_materials(make: Make) -> None:
    """Textbook formulas for E = 200, nu = 0.25, rho = 2 (lambda = mu = 80)."""
    young, nu, rho = 200.0, 0.25, 2.0
    given = {"from": "moduli", "density": rho, "lame": 80.0, "shear": 80.0}
    block = {"only": "continuum", "domain__box": [[0, 40]] * 3}

    def speeds(**changes: Any) -> list[float]:
        case = make(**changes)
        return [rho * case.wave_speed(kind) ** 2 for kind in ("P", "S", "bar")]

    strain = young * (1 - nu) / (1 + nu) / (1 - 2 * nu)
    assert speeds(continuum__material=given) == pytest.approx([strain, 80, young / (1 - nu**2)])
    sheet = given | {"plane": "stress"}
    assert speeds(continuum__material=sheet) == pytest.approx([young / (1 - nu**2), 80, young])
    assert speeds(continuum__material=given, **block) == pytest.approx([strain, 80, young])
    crystal = given | {"from": "hyperelastic", "coefficients": [], "strain_limit": 0.06}
    assert speeds(continuum__material=crystal) == speeds(continuum__material=given)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_stiffness_of_an_isotropic_material_gives_its_speeds(make: Make, dim: int) -> None:
    box = {"only": "continuum", "domain__box": [[0, 40]] * dim}
    case = make(**box)
    tensor = {"from": "stiffness", "density": 0.93, "stiffness": case.stiffness().tolist()}
    same = make(**box, continuum__material=tensor)
    for kind in ("P", "S", "bar"):
        assert same.wave_speed(kind) == pytest.approx(case.wave_speed(kind), rel=1e-12)


def test_cubic_crystal(make: Make) -> None:
    """Copper, C11 = 168.4, C12 = 121.4, C44 = 75.4 GPa: along [100] 4.34 and 2.90 km/s.

    E along [100] is (C11 - C12)(C11 + 2 C12) / (C11 + C12) = 66.7 GPa (Nye).
    """
    matrix = np.diag([168.4 - 121.4] * 3 + [75.4] * 3)
    matrix[:3, :3] += 121.4
    material = {"from": "stiffness", "density": 8960, "stiffness": (matrix * 1e9).tolist()}
    box = {"only": "continuum", "domain__box": [[0, 40]] * 3}
    case = make(units="si", continuum__material=material, **box)
    assert case.wave_speed("P") == pytest.approx(4340, rel=2e-3)
    assert case.wave_speed("S") == pytest.approx(2900, rel=2e-3)
    assert case.wave_speed("bar") == pytest.approx((66.7e9 / 8960) ** 0.5, rel=2e-3)


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
    assert make().zones().regions[0].interfaces == ((False, True), (True, True))
    strip = make(domain__periodic=[False, True], md__region=[[0, 80], [0, 80]])
    assert strip.zones().regions[0].interfaces == ((False, True), (False, False))
    alone = make(only="md")
    assert alone.zones().regions[0].interfaces == ((False, False), (False, False))
    assert alone.zones().regions[0].box == alone.domain.box
    assert alone.roles() == ("md",)
    assert make().roles() == ("md", "continuum")


def test_default_zones(make: Make) -> None:
    zones = make().zones()  # cell 4, layers of 2
    assert (zones.outer, zones.incommunicado, zones.inner, zones.filter) == (4.0, 0.0, 14.0, 8.0)
    zones = make(coupling__zones={"outer": 5, "incommunicado": 2}).zones()
    assert (zones.outer, zones.incommunicado, zones.inner, zones.filter) == (5.0, 2.0, 14.0, 8.0)


def test_background_grid_covers_the_domain(make: Make) -> None:
    grid = make(domain__periodic=[False, True]).background_grid()
    assert (grid.origin, grid.cell, grid.cells) == ((0.0, 0.0), 4.0, (30, 20))
    assert grid.periodic == (False, True)


@pytest.mark.parametrize(
    ("ramp", "time", "factor"), [(0, 0, 1), (10, 0, 0), (10, 5, 0.5), (10, 10, 1), (10, 99, 1)]
)
def test_ramp(ramp: float, time: float, factor: float) -> None:
    assert Face(condition="traction", value=(0.0, 1.0), ramp=ramp).factor(time) == factor


def test_history_is_linear_between_and_constant_beyond() -> None:
    face = Face(condition="velocity", value=(1.0, 0.0), history=((1, 2), (3, -2), (4, 0)))
    times = (0, 1, 1.5, 2, 3, 3.5, 4, 9)
    assert [face.factor(t) for t in times] == [2, 2, 1, 0, -2, -1, 0, 0]


@pytest.mark.parametrize(
    "timed", [{}, {"ramp": 0.7}, {"history": ((0.1, 0.0), (0.4, 2.0), (0.5, -1.0))}]
)
@pytest.mark.parametrize(("start", "end"), [(0.0, 1.0), (0.05, 0.45), (0.42, 0.48), (0.9, 2.0)])
def test_mean_factor_is_the_mean(timed: dict[str, Any], start: float, end: float) -> None:
    face = Face(**timed)
    middle = start + (np.arange(10_000) + 0.5) / 10_000 * (end - start)
    # the midpoint rule is exact but for the cells with a corner: 30 / du^2 / 8 < 1e-6
    assert face.mean_factor(start, end) == pytest.approx(
        np.mean([face.factor(t) for t in middle]), abs=1e-6
    )


def test_levels_halve_cells_and_steps_refer_to_the_finest(make: Make) -> None:
    refined = [{"boxes": [[[0, 112], [0, 80]]]}, {"boxes": [[[0, 104], [0, 80]]]}]
    case = make(grid__levels=refined)
    assert case.level_cells() == (4.0, 2.0, 1.0)
    assert case.finest_cell() == 1.0
    assert case.level_boxes()[0] == (case.domain.box,)
    assert case.level_boxes()[2] == (((0.0, 104.0), (0.0, 80.0)),)
    assert case.background_grid().cells == (120, 80)
    zones = case.zones()
    assert (zones.outer, zones.incommunicado, zones.inner, zones.filter) == (1.0, 0.0, 3.5, 2.0)
    assert case.filter_rate() == pytest.approx(0.5 * case.wave_speed("P"))
    assert case.step() == 40 * 0.002
    auto, coarse = (make(time__md_steps="auto", grid__levels=x) for x in (refined, []))
    assert auto.md_steps() == round(coarse.md_steps() / 4)


def test_step_without_atoms(make: Make) -> None:
    alone = {"md": ..., "only": "continuum"}
    case = make(**alone, time={"end": 8}, grid__levels=[{"boxes": [[[16, 40], [16, 40]]]}])
    assert case.step() * case.wave_speed("P") / 2.0 == pytest.approx(0.4)
    assert make(**alone, time={"end": 8, "step": 0.1}).step() == 0.1
    assert make(only="continuum").step() == 0.08  # of a coupled case: N dt_MD
    assert case.scripts() == []
    assert case.zones().regions[0].box == case.domain.box
    for ask in (lambda: case.atoms, case.md_timestep):
        with pytest.raises(ValueError, match="no "):
            ask()


def test_three_dimensions(make: Make) -> None:
    case = make(only="continuum", domain__box=[[0, 40], [0, 80], [0, 20]], continuum__ranks=8)
    assert case.dim == 3
    assert case.domain.periodic == (False,) * 3
    assert case.continuum_patches() == (2, 4, 1)  # cubes of 20
    assert case.zones().regions[0].interfaces == ((False, False),) * 3
    assert case.background_grid().cells == (10, 20, 5)


@given(st.integers(1, 10**9))
def test_continuum_patches_use_every_rank(make: Make, ranks: int) -> None:
    for box in ([[0, 10], [0, 7]], [[0, 10], [0, 7], [0, 3]]):
        assert math.prod(make(domain__box=box, continuum__ranks=ranks).continuum_patches()) == ranks


def test_faces_by_axis_and_side(make: Make) -> None:
    case = make(boundary={name: {"ramp": i} for i, name in enumerate(("left", "right", "bottom"))})
    assert [case.boundary.face(a, s).ramp for a in (0, 1) for s in (0, 1)] == [0, 1, 2, 0]
    case = make(boundary={"back": {"ramp": 1}, "front": {"ramp": 2}})
    assert [case.boundary.face(2, side).ramp for side in (0, 1)] == [1, 2]


def test_digest_tells_cases_apart_and_ignores_the_order_of_keys(make: Make) -> None:
    case = make(md__variables={"a": 1.0, "b": 2.0})
    assert case.digest() == make(md__variables={"b": 2.0, "a": 1.0}).digest()
    assert case.digest() != make(md__variables={"a": 1.0, "b": 2.5}).digest()
    assert msgspec.convert(msgspec.to_builtins(case), Case).digest() == case.digest()


def test_output_interval_in_steps(make: Make) -> None:
    assert make(output__interval=1).output_every() == 12  # 12.5 steps of 0.08
    assert make(output__interval=0.01).output_every() == 1


@pytest.mark.parametrize(
    ("end", "wanted", "every", "steps"),
    [
        (1.0, None, 1, 13),  # of 0.08
        (80.0, None, 5, 1000),
        (80.0, 0.56, 5, 1000),  # seven do not end there, six neither
        (80.08, None, 5, 1005),  # 1001 is 7 x 11 x 13
        (80.0, 0.01, 1, 1000),
        (80.0, 1e6, 1000, 1000),
    ],
)
def test_energies_are_those_of_the_end_too(
    make: Make, end: float, wanted: float | None, every: int, steps: int
) -> None:
    case = make(time__end=end, output__energy_interval=wanted)
    assert (case.energies_every(), case.steps()) == (every, steps)


def test_energies_are_those_of_common_times(make: Make) -> None:
    refined = [{"boxes": [[[0, 32], [8, 40]]]}, {"boxes": [[[0, 24], [16, 32]]]}]
    case = make(time__end=80.0, output__energy_interval=0.7, grid__levels=refined)
    assert (case.energies_every(), case.steps()) == (8, 1000)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ("reference", "lumped", "musl", 0)),
        ({"continuum__configuration": "current"}, ("current", "lumped", "musl", 20)),
        ({"coupling__scheme": "paper"}, ("current", "lumped", "musl", 20)),
        ({"only": "continuum"}, ("current", "lumped", "usavg", 20)),
        ({"coupling__scheme": "force"}, ("reference", "corrected", "musl", 0)),
        (
            {"coupling__scheme": "force", "continuum__dispersion": "lumped"},
            ("reference", "lumped", "musl", 0),
        ),
        (
            {"coupling__scheme": "force", "only": "continuum"},
            ("current", "lumped", "usavg", 20),
        ),
        (
            {"only": "continuum", "continuum__configuration": "reference"},
            ("reference", "lumped", "usavg", 0),
        ),
        (
            {
                "only": "continuum",
                "continuum__configuration": "reference",
                "continuum__dispersion": "corrected",
            },
            ("reference", "corrected", "musl", 0),
        ),
        (
            {"continuum__configuration": "current", "continuum__xpic__every": 3},
            ("current", "lumped", "musl", 3),
        ),
    ],
)
def test_automatic_schemes_of_the_continuum(
    make: Make, changes: dict[str, Any], expected: tuple[str, str, str, int]
) -> None:
    case = make(**changes)
    chosen = case.configuration(), case.dispersion(), case.integrator(), case.xpic_every()
    assert chosen == expected
