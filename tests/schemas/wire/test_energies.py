"""Sums of energies over ranks."""

from __future__ import annotations

import math
import random

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.wire.energies import Energies, components, from_components, total
from gimpmd_schemas.wire.fields import ENERGY_FIELDS

SCALARS = set(Energies.__struct_fields__) - {"momentum"}
NUMBER = st.floats(-1e6, 1e6)
ENERGIES = st.builds(
    Energies, **dict.fromkeys(SCALARS, NUMBER), momentum=st.tuples(NUMBER, NUMBER, NUMBER)
)


def energies(kinetic: float, dim: int = 2) -> Energies:
    zeros = dict.fromkeys(SCALARS, 0.0)
    return Energies(**{**zeros, "kinetic": kinetic}, momentum=(kinetic,) * dim)


@given(st.lists(ENERGIES, min_size=1, max_size=8), st.randoms())
def test_the_order_of_ranks_does_not_matter(ranks: list[Energies], order: random.Random) -> None:
    shuffled = list(ranks)
    order.shuffle(shuffled)
    assert total(ranks) == total(shuffled)


def test_sums_do_not_lose_small_ranks() -> None:
    whole = total([energies(1e16), energies(1.0), energies(-1e16)])
    assert whole == energies(1.0)


def test_one_rank_without_energies_leaves_the_side_without_energies() -> None:
    assert total([energies(1.0), None]) is None
    assert total([None]) is None


def test_components_have_the_names_of_the_table_in_every_dimension() -> None:
    for dim in (2, 3):
        names = [name for field in ENERGY_FIELDS for name in field.components(dim)]
        values = components(energies(1.5, dim), dim)
        assert list(values) == names
        assert values["kinetic"] == values[names[-1]] == 1.5
        empty = components(None, dim)
        assert list(empty) == names
        assert all(map(math.isnan, empty.values()))


@given(ENERGIES)
def test_energies_are_made_of_their_components_again(side: Energies) -> None:
    assert from_components(components(side, 3)) == side
    assert from_components(components(None, 3)) is None


def test_the_table_names_the_fields_of_the_struct() -> None:
    assert tuple(field.name for field in ENERGY_FIELDS) == Energies.__struct_fields__


@given(ENERGIES)
def test_energies_pass_through_a_message_bit_for_bit(sent: Energies) -> None:
    assert msgspec.json.decode(msgspec.json.encode(sent), type=Energies) == sent
