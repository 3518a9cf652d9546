"""The hexagonal crystal of the tests of ``gimpmd verify interface``, and strips cut from it."""

from __future__ import annotations

import math

import msgspec

from gimpmd_deploy.verify.strips import Ground
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


def ground(period: tuple[float, float], axis: int = 0, **changes: object) -> Ground:
    case = msgspec.convert(changed(CASE, {"continuum.threads": 1, **changes}), Case)
    low = (-1.5, 2.0)
    repeat = Repeat(low=low, size=(3 * period[0], 2 * period[1]), period=period)
    return Ground.of(case, "bulk.in", repeat, 0 if axis == 0 else 1)
