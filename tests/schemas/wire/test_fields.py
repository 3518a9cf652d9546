"""The table of fields."""

from __future__ import annotations

from typing import get_args

import pytest

from gimpmd_schemas.case.form import Role, SchemeName
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.fields import (
    ENERGY_FIELDS,
    STEP_FIELDS,
    TOTAL_FIELDS,
    ZONE_FIELDS,
    Sender,
    sent_fields,
)

TABLES = (ZONE_FIELDS, ENERGY_FIELDS, TOTAL_FIELDS, STEP_FIELDS)


def test_both_roles_send_fields_under_every_scheme() -> None:
    for scheme in get_args(SchemeName):
        for role in get_args(Role):
            assert sent_fields(role, scheme)


def test_what_each_role_sends() -> None:
    def names(role: Role, scheme: SchemeName) -> list[str]:
        return [field.name for field in sent_fields(role, scheme)]

    assert names("md", "force") == ["force"]
    assert names("md", "velocity") == names("md", "paper") == ["mass", "velocity"]
    assert names("continuum", "force") == names("continuum", "velocity") == ["velocity"]


def test_every_field_has_a_sender_a_rank_and_one_row() -> None:
    for table in TABLES:
        assert len({field.name for field in table}) == len(table)
        for field in table:
            assert field.senders
            assert set(field.senders) <= set(get_args(Sender))
            assert field.rank in (0, 1)
            assert field.meaning


@pytest.mark.parametrize("dim", [2, 3])
def test_shapes_and_components_follow_the_dimension(dim: int) -> None:
    for table in TABLES:
        for field in table:
            assert field.shape(dim) == (() if field.rank == 0 else (dim,))
            assert len(field.components(dim)) == (1 if field.rank == 0 else dim)


def test_units_are_those_of_the_style() -> None:
    momentum = ENERGY_FIELDS[-1]
    assert momentum.unit_in(UNITS["metal"]) == "g/mol A/ps"
    assert ENERGY_FIELDS[0].unit_in(UNITS["metal"]) == "eV"
    for table in TABLES:
        for field in table:
            for units in UNITS.values():
                assert "{" not in field.unit_in(units)
