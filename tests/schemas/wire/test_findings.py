"""Findings: what is one, which is the worst, and what the user reads."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import get_args

import msgspec
import pytest

from gimpmd_schemas.wire.findings import (
    MONITORS,
    Finding,
    Kind,
    check,
    monitors_look,
    sentence,
    worst,
)


def test_every_kind_is_told() -> None:
    assert tuple(MONITORS) == get_args(Kind)


def test_a_value_beyond_its_limit_is_a_finding() -> None:
    assert check("strain", 0.1, 0.1) == ()
    (found,) = check("strain", 0.11, 0.1, (1.0, 2.0))
    assert found == Finding(kind="strain", value=0.11, limit=0.1, place=(1.0, 2.0))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_a_finding_that_can_be_sent(value: float) -> None:
    (found,) = check("energy", value, 0.2)
    assert found.value > 1e300
    assert msgspec.json.decode(msgspec.json.encode(found), type=Finding) == found


def test_the_worst_of_each_kind_in_the_order_of_the_kinds() -> None:
    findings = [
        *check("strain", 0.2, 0.1, (1.0, 0.0)),
        *check("broken bond", 1.3, 1.25),
        *check("strain", 0.3, 0.1, (2.0, 0.0)),
        *check("strain", 0.25, 0.1, (3.0, 0.0)),
    ]
    for order in (findings, findings[::-1]):
        assert [f.kind for f in worst(order)] == ["broken bond", "strain"]
        assert worst(order)[1].place == (2.0, 0.0)
    assert worst([]) == []


def test_the_sentence_says_side_time_place_value_limit_and_cure() -> None:
    (found,) = check("broken bond", 1.7321, 1.25, (185.3333, 226.1))
    text = sentence("md", found, 24.96)
    assert text.startswith("atoms, t = 24.96, near (185.33, 226.1): a defect of the crystal")
    assert ": 1.732, limit 1.25)" in text
    assert text.endswith("move the faces of the MD region further from the defect")
    (found,) = check("mass", 0.5, 1e-9)
    assert sentence("continuum", found, 0.0).startswith("continuum, t = 0: the mass")


@pytest.mark.parametrize(
    ("md_steps", "energies_every", "stride"),
    [(40, 1, 20), (40, 3, 21), (20, 1, 30), (1, 7, 602), (None, 1, 20), (40, 16, 32)],
)
def test_monitors_look_at_steps_with_energies_that_are_far_enough_apart(
    md_steps: int | None, energies_every: int, stride: int
) -> None:
    md = None if md_steps is None else SimpleNamespace(steps=md_steps)
    plan = SimpleNamespace(md=md, energies_every=energies_every, steps=1000)
    looks = [step for step in range(1001) if monitors_look(plan, step)]
    assert looks == sorted({*range(0, 1001, stride), 1000})
