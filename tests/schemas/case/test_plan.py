"""Plans: every choice is made, and a plan survives its file bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import FACES, Case
from gimpmd_schemas.case.plan import Plan, load_plan, make_plan, write_plan
from gimpmd_schemas.errors import InputError

Make = Callable[..., Case]
CRYSTAL = {
    "vectors": [[1.1132, 0.0], [0.5566, 0.9641]],
    "origin": [0.1, 0.2],
    "bonds": [[1.1132, 0.0], [0.5566, 0.9641], [-0.5566, 0.9641]],
    "energy": [[0.0, 9.0, -18.0]] * 3,
    "stretch_limit": 0.3,
}
FORCE = {
    "coupling__scheme": "force",
    "coupling__crystal": CRYSTAL,
    "coupling__planes": {"right": 70.0, "bottom": 30.0, "top": 50.0},
}
ALONE = {"only": "continuum", "md": ..., "time": {"end": 8}}
BLOCK = ALONE | {"domain__box": [[0, 40], [0, 40], [0, 24]]}
CASES = {
    "velocity": {},
    "paper": {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]},
    "force": FORCE,
    "absorber": FORCE | {"coupling__absorber": {"rate": 1.0}},
    "md only": {"only": "md"},
    "continuum only": ALONE,
    "block": BLOCK,
    "levels": ALONE | {"grid__levels": [{"boxes": [[[16, 64], [16, 64]]]}]},
}


def values(part: object, key: str = "") -> Iterator[tuple[str, object]]:
    """All values of a plan with their keys."""
    if isinstance(part, dict):
        for name, item in part.items():
            yield from values(item, f"{key}.{name}" if key else str(name))
    elif isinstance(part, list | tuple):
        for index, item in enumerate(part):
            yield from values(item, f"{key}[{index}]")
    else:
        yield key, part


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES.keys())
def test_a_plan_survives_its_file(make: Make, tmp_path: Path, changes: dict[str, Any]) -> None:
    plan = make_plan(make(**changes))
    write_plan(plan, tmp_path / "plan.yaml")
    back = load_plan(tmp_path / "plan.yaml")
    assert back == plan
    assert back.digest() == plan.digest()
    assert plan.digest() == sha256((tmp_path / "plan.yaml").read_bytes()).hexdigest()


def test_infinite_planes_survive_the_file(make: Make, tmp_path: Path) -> None:
    plan = make_plan(make(**FORCE))
    assert plan.coupled.interfaces[0].planes[0] == (-math.inf, 70.0)
    write_plan(plan, tmp_path / "plan.yaml")
    assert load_plan(tmp_path / "plan.yaml").coupled.interfaces == plan.coupled.interfaces


@given(st.floats(1e-6, 1e6), st.floats(0.5, 2.0), st.sampled_from(sorted(CASES)))
def test_floats_survive_the_file_bit_for_bit(
    make: Make, tmp_path_factory: pytest.TempPathFactory, shear: float, end: float, name: str
) -> None:
    material = {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": shear}
    plan = make_plan(make(**CASES[name], continuum__material=material, time__end=end))
    path = tmp_path_factory.mktemp("plan") / "plan.yaml"
    write_plan(plan, path)
    assert load_plan(path) == plan


@given(
    st.sampled_from(sorted(CASES)),
    st.fixed_dictionaries(
        {},
        optional={
            "continuum__integrator": st.sampled_from(["auto", "musl"]),
            "continuum__configuration": st.sampled_from(["auto", "current", "reference"]),
            "continuum__dispersion": st.sampled_from(["auto", "lumped"]),
            "continuum__ranks": st.integers(1, 8),
            "continuum__threads": st.sampled_from(["auto", 2]),
            "continuum__xpic__every": st.sampled_from(["auto", 0]),
            "output__energy_interval": st.none() | st.floats(0.1, 4.0),
        },
    ),
)
def test_no_auto_and_no_open_choice_survives(
    make: Make, name: str, changes: dict[str, Any]
) -> None:
    case = make(**CASES[name] | changes)
    if check_case(case):
        return
    plan = make_plan(case)
    found = dict(values(msgspec.to_builtins(plan)))
    assert [key for key, value in found.items() if value == "auto"] in (
        [],
        ["continuum.threads"],
    )
    # what may be absent: a side that does not take part, and what the user did not ask for
    absent = {key for key, value in found.items() if value is None}
    optional = ("md", "md.after", "md.cutoff", "only", "coupling", "coupling.crystal")
    optional += (
        "coupling.sites",
        "coupling.absorber",
        "continuum.temperature",
        "continuum.body_force",
        "continuum.mesh",
    )
    optional += tuple(f"coupling.interfaces[0].{name}" for name in ("second", "period"))
    optional += ("continuum.patches",)  # cut by the solver
    optional += tuple(f"boundary.{name}.stiffness" for name in FACES)
    assert absent <= {*optional, "initial.stretch"}


def test_a_plan_knows_its_roles_and_ranks(make: Make) -> None:
    plan = make_plan(make(md__ranks=2, continuum__ranks=4))
    assert plan.roles == ("md", "continuum")
    assert (plan.ranks("md"), plan.ranks("continuum")) == (2, 4)
    alone = make_plan(make(**ALONE))
    assert alone.roles == ("continuum",)
    with pytest.raises(ValueError, match="no atoms"):
        _ = alone.atoms
    with pytest.raises(ValueError, match="one side only"):
        _ = alone.coupled


def test_the_digest_tells_plans_apart_and_ignores_the_order_of_keys(make: Make) -> None:
    plan = make_plan(make(md__variables={"a": 1.0, "b": 2.0}))
    assert plan.digest() == make_plan(make(md__variables={"b": 2.0, "a": 1.0})).digest()
    assert plan.digest() != make_plan(make(md__variables={"a": 1.0, "b": 2.5})).digest()


def test_an_unmeasured_material_has_no_plan(make: Make) -> None:
    with pytest.raises(ValueError, match="not been measured"):
        make_plan(make(continuum__material={"from": "md", "cell": "cell.in"}))


def test_planes_that_are_not_found_have_no_plan(make: Make) -> None:
    with pytest.raises(ValueError, match="planes of the interface have not been found"):
        make_plan(make(coupling__scheme="force"))


def test_a_missing_or_foreign_plan_is_bad_input(make: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="plan: No such file"):
        load_plan(tmp_path / "plan.yaml")
    (tmp_path / "plan.yaml").write_text("name: old\nspeed: 3\n")
    with pytest.raises(InputError, match="plan"):
        load_plan(tmp_path / "plan.yaml")


def test_three_dimensions(make: Make) -> None:
    plan: Plan = make_plan(make(**BLOCK))
    assert plan.dim == 3
    assert plan.background_grid().cells == (10, 10, 6)
    assert plan.stiffness().shape == (6, 6)
