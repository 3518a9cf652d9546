"""All checks together."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.derive.regions import md_patches
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan

Make = Callable[..., Case]


def test_the_sound_case_is_sound(make: Make) -> None:
    assert check_case(make()) == []


def test_all_problems_are_found_at_once(make: Make) -> None:
    found = check_case(make(md__cutoff=99.0, boundary__left={"value": [1, 0]}, md__patches=[2, 2]))
    assert {p.key for p in found} == {"coupling.zones.outer", "boundary.left.value", "md.patches"}


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
            "grid__points_per_axis": st.integers(-(2**63), 2**63 - 1),
            "time__end": wild,
            "time__md_timestep": wild,
            "time__md_steps": st.integers(-(2**63), 2**63 - 1) | st.just("auto"),
            "md__ranks": st.integers(-(2**63), 2**63 - 1),
            "md__patches": st.tuples(*[st.integers(-(2**63), 2**63 - 1)] * 2).map(list),
            "continuum__material": st.fixed_dictionaries(
                {"from": st.just("moduli"), "density": wild, "lame": wild, "shear": wild}
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
def test_senseless_numbers_give_problems_and_no_exception(
    make: Make, changes: dict[str, Any]
) -> None:
    case = make(**changes)
    if not check_case(case):
        assert times.steps(case) >= 1
        assert times.output_every(case) >= 1
        if case.md.patches == "auto":
            assert prod(md_patches(case)) == case.md.ranks
        zones(case)
        make_plan(case).background_grid()
