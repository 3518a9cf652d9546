"""What the whole body may gain in the velocity schemes."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from gimpmd_coupler.body_watch import BodyWatch
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.plausibility import GAIN
from tests.cases import BAR, CASE, changed


def plan(**changes: Any) -> Plan:
    return make_plan(msgspec.convert(changed(CASE, {"time.end": 8.0} | changes), Case))


def side(**values: float) -> Energies:
    known = dict.fromkeys(
        ("kinetic", "potential", "external_work", "interface_work", "dissipated"), 0.0
    )
    return Energies(**known | {"mass": 1.0, "momentum": (0.0, 0.0)} | values)


def test_it_looks_where_monitors_look_and_no_side_can() -> None:
    one = plan()
    watch = BodyWatch(one)
    assert [step for step in range(101) if watch.looks(step)] == [0, 20, 40, 60, 80, 100]
    assert BodyWatch(plan(**{"coupling.scheme": "paper"})).looks(20)
    force = msgspec.structs.replace(one.coupled, scheme="force")
    assert not BodyWatch(msgspec.structs.replace(one, coupling=force)).looks(20)
    assert not BodyWatch(make_plan(msgspec.convert(BAR, Case))).looks(0)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_gain_of_both_sides_together(share: float) -> None:
    watch = BodyWatch(plan())
    assert watch.look([side(kinetic=2.0), side(kinetic=1.0)]) == ()
    gain = share * GAIN * 4.0
    found = watch.look([side(kinetic=3.0 + gain, external_work=1.0), side(kinetic=1.0)])
    assert [one.kind for one in found] == (["total energy"] if share > 1.0 else [])
    for one in found:
        assert one.value == pytest.approx(share * GAIN, rel=1e-6)


def test_what_one_side_gives_to_the_other_is_no_gain_and_a_loss_is_none_either() -> None:
    watch = BodyWatch(plan())
    watch.look([side(kinetic=2.0), side()])
    assert watch.look([side(), side(potential=2.0)]) == ()
    assert watch.look([side(), side()]) == ()


def test_work_of_the_interface_is_no_source() -> None:
    watch = BodyWatch(plan())
    watch.look([side(kinetic=1.0), side()])
    assert watch.look([side(kinetic=2.0, interface_work=1.0), side()])


def test_energy_that_damping_took_is_not_missing_when_it_comes_from_nowhere() -> None:
    watch = BodyWatch(plan())
    watch.look([side(kinetic=1.0), side()])
    assert watch.look([side(kinetic=0.5), side(dissipated=0.5)]) == ()
    assert watch.look([side(kinetic=1.5), side(dissipated=0.5)])


def test_a_step_without_energies_is_no_finding() -> None:
    assert BodyWatch(plan()).look([side(), None]) == ()


def test_it_goes_on_from_the_steps_on_record() -> None:
    """Work that was given back remains what explains."""
    earlier = [[side(), side()], [side(kinetic=9.0, external_work=9.0), side()]]
    first, second = BodyWatch(plan()), BodyWatch(plan())
    for sides in earlier:
        assert first.look(sides) == ()
    second.catch_up(earlier)
    for watch in (first, second):
        assert watch.look([side(kinetic=0.99 * GAIN * 9.0), side()]) == ()
        (found,) = watch.look([side(kinetic=1.01 * GAIN * 9.0), side()])
        assert found.value == pytest.approx(1.01 * GAIN, rel=1e-6)
