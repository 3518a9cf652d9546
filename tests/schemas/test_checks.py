"""Meaning of a case: every rule has a case that breaks it, and one that just keeps it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case import Case
from gimpmd_schemas.checks import HUGE, check_case, check_stability

Make = Callable[..., Case]
LEFT = {"condition": "traction", "value": [1, 0]}
MEASURED = {"from": "md", "cell": "cell.in"}


def crack(x: float, y: float = 40.0) -> list[dict[str, Any]]:
    """A crack from the left face to a point."""
    return [{"from": [0, 40], "to": [x, y]}]


def packet(**changes: Any) -> list[dict[str, Any]]:
    """A packet with changes."""
    return [{"center": 60, "wavelength": 10, "strain": 1e-4} | changes]


def material(**changes: Any) -> dict[str, Any]:
    """The sound material with changes."""
    return {"from": "case", "density": 0.93, "lame": 27.8, "shear": 27.8} | changes


def crystal(**changes: Any) -> dict[str, Any]:
    """A strain energy of degree three, which has 16 terms."""
    energy = {"coefficients": [1.0] * 16, "reach": 0.06} | changes
    return material(**{"from": "hyperelastic"}, **energy)


# cell 4, two layers a cell: outer 4, incommunicado 2, inner 12; innermost at depth 18
BREAKS: list[tuple[str, dict[str, Any], str]] = [
    ("grid.cell", {"grid__cell": 0.0}, "must be positive"),
    ("grid.cell", {"grid__cell": float("nan")}, "must be a number between"),
    ("time.end", {"time__end": float("inf")}, "must be a number between"),
    ("time.end", {"time__end": 2 * HUGE}, "must be a number between"),
    ("time.md_timestep", {"time__md_timestep": 0.5 / HUGE}, "must be a number between"),
    ("md.variables.a", {"md__variables": {"a": float("nan")}}, "must be a number between"),
    ("boundary.top.value[1]", {"boundary__top": LEFT | {"value": [0, float("inf")]}}, "between"),
    ("time.end", {"time__end": -1}, "must be positive"),
    ("time.md_timestep", {"time__md_timestep": 0}, "must be positive"),
    ("time.md_steps", {"time__md_steps": 0}, "must be positive"),
    ("output.interval", {"output__interval": 0}, "must be positive"),
    ("grid.points_per_cell", {"grid__points_per_cell": 0}, "must be positive"),
    ("grid.points_per_cell", {"grid__points_per_cell": 5}, "must be 1, 2, 3 or 4"),
    ("md.ranks", {"md__ranks": 0}, "must be positive"),
    ("md.ranks", {"md__ranks": 201}, "more than the 200 cells"),
    ("md.ranks", {"md__ranks": 2**62}, "more than the 200 cells"),
    ("md.cutoff", {"md__cutoff": 0}, "must be positive"),
    ("continuum.ranks", {"continuum__ranks": 601}, "more than the 600 cells"),
    ("continuum.ranks", {"continuum__ranks": 0}, "must be positive"),
    ("continuum.threads", {"continuum__threads": 0}, "must be positive"),
    ("continuum.xpic.order", {"continuum__xpic__order": 0}, "must be at least 1"),
    ("continuum.xpic.every", {"continuum__xpic__every": -1}, "must not be negative"),
    ("continuum.material.density", {"continuum__material": material(density=0)}, "positive"),
    ("continuum.material.shear", {"continuum__material": material(shear=0)}, "positive"),
    ("continuum.material.lame", {"continuum__material": material(lame=-27.8)}, "must exceed"),
    ("continuum.material.reach", {"continuum__material": crystal(reach=0)}, "positive"),
    (
        "continuum.material.coefficients",
        {"continuum__material": crystal(coefficients=[1.0] * 15)},
        "not those of a polynomial in 3 strains",
    ),
    ("coupling.zones.outer", {"coupling__zones__outer": 0}, "must be positive"),
    ("coupling.zones.inner", {"coupling__zones__inner": -1}, "must be positive"),
    ("coupling.zones.filter", {"coupling__zones__filter": 0}, "must be positive"),
    ("coupling.zones.incommunicado", {"coupling__zones__incommunicado": -0.1}, "negative"),
    ("coupling.filter_rate", {"coupling__filter_rate": -1}, "must not be negative"),
    ("name", {"name": ""}, "folder's name"),
    ("name", {"name": "../up"}, "folder's name"),
    ("name", {"name": ".hidden"}, "folder's name"),
    ("name", {"name": "a/b"}, "folder's name"),
    ("name", {"name": "a*"}, "folder's name"),
    ("domain.box", {"domain__box": [[0, 120], [80, 0]]}, "upper y is not above lower y"),
    ("md.region", {"md__region": [[80, 0], [20, 60]]}, "upper x is not above lower x"),
    ("grid.cell", {"grid__cell": 7}, "does not divide the domain along x"),
    ("grid.cell", {"grid__cell": 1e-3}, "makes 9.6e+09 cells"),
    ("md.region", {"md__region": [[-1, 80], [20, 60]]}, "leaves the domain along x"),
    ("md.region", {"domain__periodic": [False, True]}, "must span the whole domain"),
    ("time.end", {"time__end": 0.0019}, "comes before the first MD step"),
    ("md.region", {"md__region": [[0, 120], [0, 80]]}, "nothing to couple"),
    ("coupling.zones.outer", {"md__cutoff": 4.01}, "narrower than the potential's cutoff"),
    ("continuum.integrator", {"continuum__integrator": "usavg"}, "does not fit the velocity"),
    ("coupling.zones.inner", {"coupling__zones__inner": 7.9}, "narrower than four layers"),
    ("coupling.zones", {"md__region": [[0, 80], [22, 58]]}, "do not fit the MD region along y"),
    ("md.region", {"md__region": [[0, 80], [20, 72.1]]}, "within 7.9 of the domain's top face"),
    ("boundary.left.ramp", {"boundary__left": LEFT | {"ramp": -1}}, "must not be negative"),
    ("boundary.left.value", {"boundary__left": {"condition": "traction"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"condition": "velocity"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"value": [1, 0]}}, "takes no value"),
    (
        "boundary.left.value",
        {"boundary__left": {"condition": "symmetry", "value": [0, None]}},
        "takes no value",
    ),
    (
        "boundary.top.condition",
        {
            "domain__periodic": [False, True],
            "md__region": [[0, 80], [0, 80]],
            "boundary__top": {"condition": "symmetry"},
        },
        "periodic axis",
    ),
    ("md.patches", {"md__ranks": 4, "md__patches": [3, 1]}, "3 x 1 = 3"),
    ("md.patches", {"md__ranks": 4, "md__patches": [-2, -2]}, "do not tile"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(0)}, "has no length"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(-1)}, "leaves the domain"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(62)}, "reaches the zones"),
    ("initial.packets[0].wavelength", {"initial__packets": packet(wavelength=0)}, "positive"),
    ("initial.packets[0].cycles", {"initial__packets": packet(cycles=0)}, "positive"),
    ("initial.packets[0].center", {"initial__packets": packet(center=121)}, "leaves the domain"),
    ("initial.packets[0].center", {"initial__packets": packet(center=81, axis=1)}, "leaves"),
    ("time.md_steps", {"time__md_steps": 212}, "c dt / h"),
]

KEEPS: list[dict[str, Any]] = [
    {},
    {"grid__points_per_cell": 4},
    {"grid__points_per_cell": 1, "coupling__zones__inner": 16, "md__region": [[0, 80], [12, 68]]},
    {"md__ranks": 200},
    {"md__cutoff": 4.0},
    {"coupling__zones__inner": 8.0},
    {"coupling__zones__incommunicado": 0},
    {"coupling__filter_rate": 0},
    {"continuum__xpic__every": 0},
    {"continuum__material": material(lame=-27.79)},
    {"continuum__material": crystal()},
    {"continuum__integrator": "musl"},
    {"only": "continuum", "continuum__integrator": "usavg"},
    {"only": "continuum", "continuum__cracks": crack(119)},
    {"only": "md", "md__region": [[0, 120], [0, 80]]},
    {"time__end": 0.002},
    {"md__region": [[0, 80], [21.9, 58.0]]},  # 36.1 wide; the zones take 36
    {"md__region": [[0, 80], [20, 72]]},  # 8 to the face, two cells
    {"domain__periodic": [False, True], "md__region": [[0, 80], [0, 80]]},
    {"boundary__left": {"condition": "velocity", "value": [None, 0]}},
    {"boundary__left": LEFT},
    {"md__ranks": 4, "md__patches": [4, 1]},
    {"continuum__cracks": crack(61.9)},  # depth 18.1
    {"initial__packets": packet(center=120)},
    {"name": "Mode-1_small.2"},
    {"time__md_steps": 211},
    {"time__md_steps": "auto"},
    {"continuum__material": MEASURED, "time__md_steps": "auto"},
]


def test_the_sound_case_is_sound(make: Make) -> None:
    assert check_case(make()) == []


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    found = check_case(make(**changes))
    matching = [p for p in found if p.key == key and said in p.message]
    assert matching, [str(p) for p in found]
    # a way out: a hint, or a message that says what must be
    assert all(p.hint or "must" in p.message for p in found), [str(p) for p in found]


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert [str(p) for p in check_case(make(**changes))] == []


def test_all_problems_are_found_at_once(make: Make) -> None:
    found = check_case(make(md__cutoff=99.0, boundary__left={"value": [1, 0]}, md__patches=[2, 2]))
    assert {p.key for p in found} == {"coupling.zones.outer", "boundary.left.value", "md.patches"}


def test_cfl_hint_is_stable(make: Make) -> None:
    """The hint's number of steps is accepted; one more is not."""
    (problem,) = check_stability(make(time__md_steps=1000))
    most = int(problem.hint.split()[2])
    assert check_stability(make(time__md_steps=most)) == []
    assert check_stability(make(time__md_steps=most + 1)) != []
    (problem,) = check_stability(make(time__md_timestep=10.0, time__md_steps=1))
    assert "enlarge grid.cell" in problem.hint


def test_md_time_step_against_the_lattice(make: Make) -> None:
    limit = 0.5 / (2.31 * make().wave_speed("P") / 1.1132)
    assert check_stability(make(time__md_timestep=limit * 0.99, time__md_steps=1), 1.1132) == []
    (problem,) = check_stability(make(time__md_timestep=limit * 1.01, time__md_steps=1), 1.1132)
    assert problem.key == "time.md_timestep"
    alone = make(time__md_timestep=limit * 1.01, time__md_steps=1, only="continuum")
    assert check_stability(alone, 1.1132) == []


def test_files_beside_the_case(make: Make, tmp_path: Path) -> None:
    case = make(md__after="after.in", md__files=["table.txt"], continuum__material=MEASURED)
    missing = check_case(case, tmp_path)
    keys = {"md.input", "md.after", "md.files[0]", "continuum.material.cell"}
    assert {p.key for p in missing} == keys
    assert all(str(tmp_path) in p.hint for p in missing)
    for name in ("md.in", "after.in", "table.txt", "cell.in"):
        (tmp_path / name).write_text("")
    assert check_case(case, tmp_path) == []
    (tmp_path / "md.in").unlink()
    (tmp_path / "md.in").mkdir()
    assert [p.key for p in check_case(case, tmp_path)] == ["md.input"]


wild = st.one_of(st.floats(), st.sampled_from([0.0, 1e-300, 1e300, -1.0, 1e99, 1e-99]))
wild_pair = st.tuples(wild, wild).map(list)
wild_box = st.tuples(wild_pair, wild_pair).map(list)


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "domain__box": wild_box,
            "md__region": wild_box,
            "grid__cell": wild,
            "grid__points_per_cell": st.integers(-(2**63), 2**63 - 1),
            "time__end": wild,
            "time__md_timestep": wild,
            "time__md_steps": st.integers(-(2**63), 2**63 - 1) | st.just("auto"),
            "md__ranks": st.integers(-(2**63), 2**63 - 1),
            "md__patches": st.tuples(*[st.integers(-(2**63), 2**63 - 1)] * 2).map(list),
            "continuum__material": st.fixed_dictionaries(
                {"from": st.just("case"), "density": wild, "lame": wild, "shear": wild}
            ),
            "coupling__zones__outer": wild,
            "coupling__zones__inner": wild,
            "coupling__filter_rate": wild,
            "output__interval": wild,
            "only": st.sampled_from(["md", "continuum", None]),
            "domain__periodic": st.tuples(st.booleans(), st.booleans()).map(list),
            "continuum__cracks": st.lists(
                st.fixed_dictionaries({"from": wild_pair, "to": wild_pair}), max_size=2
            ),
        },
    )
)
def test_senseless_numbers_are_judged_not_stumbled_over(
    make: Make, changes: dict[str, Any]
) -> None:
    case = make(**changes)
    if not check_case(case):
        assert case.steps() >= 1
        assert case.output_every() >= 1
        if case.md.patches == "auto":
            px, py = case.md_patches()
            assert px * py == case.md.ranks
        case.zones()
        case.background_grid()
