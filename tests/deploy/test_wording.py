"""Numbers in words."""

import pytest

from gimpmd_deploy.wording import clock, momentum_unit, quantity
from gimpmd_schemas.mechanics.units import UNITS


@pytest.mark.parametrize(
    ("value", "text"), [(12.0, "12"), (1234.0, "1.23 k"), (5.74e6, "5.74 M"), (2e9, "2 G")]
)
def test_quantity(value, text):
    assert quantity(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(2.5, "2.5 s"), (59.6, "1:00"), (125.0, "2:05"), (3725.0, "1:02:05")]
)
def test_clock(seconds, text):
    assert clock(seconds) == text


def test_unit_of_momentum():
    assert momentum_unit(UNITS["metal"]) == "g/mol A/ps"
