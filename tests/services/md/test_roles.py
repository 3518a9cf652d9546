"""Roles of atoms are bits of one integer: no two of them meet, and all fit into it."""

from __future__ import annotations

from itertools import product

import numpy as np

from gimpmd_md.roles import BOUNDARY, CORE, PROJECTED, traction_bit, velocity_bit

FACES = list(product(range(3), range(2)))
BITS = [
    *(BOUNDARY, CORE, PROJECTED),
    *(traction_bit(*face) for face in FACES),
    *(velocity_bit(*face) for face in FACES),
]


def test_every_role_is_a_bit_of_its_own() -> None:
    assert [bit.bit_count() for bit in BITS] == [1] * 15
    assert len(set(BITS)) == 15


def test_an_atom_can_have_all_of_them() -> None:
    """Codes keep roles in 32-bit integers, whose sign must stay."""
    role = np.zeros(1, dtype=np.int32)
    for bit in BITS:
        assert not role[0] & np.int32(bit)
        role |= np.int32(bit)
    assert role[0] == sum(BITS) > 0
    role &= ~np.int32(velocity_bit(2, 1))
    assert role[0] == sum(BITS[:-1])
