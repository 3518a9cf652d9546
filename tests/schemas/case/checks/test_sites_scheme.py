"""What the sites scheme needs, and what it cannot do yet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import Break, assert_breaks, assert_keeps

Make = Callable[..., Case]

SITES = {"coupling__scheme": "sites", "md__region": [[20, 60], [20, 60]]}

CUBE = SITES | {
    "domain__box": [[0, 80]] * 3,
    "md__region": [[20, 60]] * 3,
    "boundary": {},
}
"""A box of atoms inside a body of three dimensions."""

BELOW_SURFACE = CUBE | {"md__region": [[20, 60], [20, 60], [20, 80]]}
"""The same at the upper face along z."""

SLAB = CUBE | {
    "domain__periodic": [False, True, True],
    "md__region": [[20, 60], [0, 80], [0, 80]],
}
"""Atoms between two planes."""


def measured(back: float | None = 28, second_back: float = 24) -> dict[str, Any]:
    """Changes that give the planes of that box."""
    names = ("left", "right", "bottom", "top", "back", "front")
    planes = dict(zip(names, (28, 52) * 3, strict=True)) | {"back": back}
    second = dict(zip(names, (24, 56) * 3, strict=True)) | {"back": second_back}
    return {"coupling__planes": planes, "coupling__sites": found([1.0, 1.0, 1.0], second)}


def found(period: list[float], second: dict[str, float]) -> dict[str, Any]:
    """What LAMMPS has measured of an upright crystal with one atom per cell."""
    zero = [0.0] * len(period)
    vectors = np.diag(period).tolist()
    crystal = {"vectors": vectors, "origin": zero, "basis": [zero], "shift": ""}
    layers = {"period": period, "layers": period, "second": [second]}
    return crystal | layers | {"nodes": [0], "force": "", "stress": ""}


BREAKS: list[Break] = [
    ("domain.box", CUBE | {"coupling__scheme": "force"}, "only the sites scheme couples"),
    ("domain.box", CUBE | {"coupling__scheme": "velocity"}, "only the sites scheme couples"),
    ("md.minimize", BELOW_SURFACE | {"md__minimize": False}, "without rest"),
    ("coupling.planes.back", CUBE | measured(back=None), "missing at an interface"),
    ("md.region", CUBE | measured(second_back=8), "has its second plane at 8"),
    ("continuum.backend", SITES | {"continuum__backend": "fem"}, "does not know the sites scheme"),
    ("md.backend", SITES | {"md__backend": "ase"}, "does not know the sites scheme"),
    ("coupling.zones.inner", SITES | {"coupling__zones__inner": 8}, "the sites scheme has no such"),
    (
        "coupling.planes",
        SITES | {"coupling__planes": {"left": 25, "right": 55, "bottom": 25, "top": 55}},
        "belong together",
    ),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize(
    "changes",
    [SITES, CUBE, CUBE | measured(), SLAB],
)
def test_a_region_inside_the_body_is_accepted(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))


@pytest.mark.parametrize(
    "changes",
    [
        SITES | {"md__region": [[0, 60], [20, 60]]},
        BELOW_SURFACE,
    ],
)
def test_a_region_at_a_face_of_the_body_is_accepted(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))


@pytest.mark.parametrize("body", [SITES, CUBE])
def test_levels_around_a_region_are_accepted(make: Make, body: dict[str, Any]) -> None:
    whole = [[0, 80]] * len(body["md__region"])
    changes = {"grid__cell": 4, "grid__levels": [{"boxes": [whole]}]}
    assert_keeps(make(**body | changes))


def test_second_planes_need_room(make: Make) -> None:
    planes = {"left": 25, "right": 55, "bottom": 25, "top": 55}
    second = {"left": 11.5, "right": 60, "bottom": 20, "top": 60}
    changes = {"coupling__planes": planes, "coupling__sites": found([1.1, 1.9], second)}
    assert_breaks(make(**SITES | changes), "md.region", "has its second plane at 11.5")
    case = make(**SITES | changes)
    assert case.coupling.sites is not None
    far = msgspec.structs.replace(
        case.coupling.sites,
        second=(msgspec.structs.replace(case.coupling.sites.second[0], left=12.0),),
    )
    coupling = msgspec.structs.replace(case.coupling, sites=far)
    assert_keeps(msgspec.structs.replace(case, coupling=coupling))
