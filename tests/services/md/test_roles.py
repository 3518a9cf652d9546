"""Roles of atoms are bits of one integer: no two of them meet, and all fit into it."""

from __future__ import annotations

import numpy as np

from gimpmd_md.roles import BOUNDARY, CORE, PRELOADED, PROJECTED, WATCHED, part_bit
from gimpmd_schemas.case.checks.loads import MAX_PARTS

BITS = [
    *(BOUNDARY, CORE, PROJECTED, WATCHED, PRELOADED),
    *(part_bit(number) for number in range(MAX_PARTS)),
]


def test_every_role_is_a_bit_of_its_own() -> None:
    assert [bit.bit_count() for bit in BITS] == [1] * len(BITS)
    assert len(set(BITS)) == len(BITS)


def test_an_atom_can_have_all_of_them() -> None:
    """Codes keep roles in 32-bit integers, whose sign must stay."""
    role = np.zeros(1, dtype=np.int32)
    for bit in BITS:
        assert not role[0] & np.int32(bit)
        role |= np.int32(bit)
    assert role[0] == sum(BITS) > 0
    role &= ~np.int32(BITS[-1])
    assert role[0] == sum(BITS[:-1])
