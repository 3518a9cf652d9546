"""The hexagonal crystal of the tests of ``gimpmd verify interface``, and strips cut from it."""

from __future__ import annotations

import math

import msgspec

from gimpmd_deploy.verify.strips import Axis, Ground
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import Repeat
from tests.cases import CASE, changed

A = 1.1132013035564605
BULK = """\
units lj
dimension 2
boundary p p p
atom_style atomic
variable xlo equal 7 # a name that gimpmd uses too
variable a equal 1.1132013035564605
variable density equal 2/(sqrt(3)*v_a^2)
lattice hex ${density}
region cell block 0 3 0 2 -0.5 0.5
create_box 1 cell
create_atoms 1 region cell
mass 1 1
pair_style lj/cut 2.5
pair_coeff 1 1 1 1
"""
MEASURED = {"from": "md", "cell": "bulk.in"}
HEXAGONAL = (A, math.sqrt(3) * A)
"""Periods of the crystal along x and y."""


IN_SPACE: dict[str, object] = {
    "domain.box": [[0, 120], [0, 80], [0, 80]],
    "domain.periodic": [False, True, True],
    "md.region": [[0, 60], [0, 80], [0, 80]],
    "coupling": {"scheme": "sites"},
    "boundary": {},
}
"""Changes that make the block of ``tests.cases`` one of three dimensions."""


def ground(period: tuple[float, ...], axis: Axis = 0, **changes: object) -> Ground:
    case = msgspec.convert(changed(CASE, {"continuum.threads": 1, **changes}), Case)
    size = tuple(count * edge for count, edge in zip((3, 2, 2), period, strict=False))
    repeat = Repeat(low=(-1.5, 2.0, 0.5)[: len(period)], size=size, period=period)
    return Ground.of(case, "bulk.in", repeat, axis)
