"""A sound case, and variants of it by key."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import msgspec
import pytest
from hypothesis import settings

from gimpmd_schemas.case.form import Case

# the same examples in every run, and no deadline for numba's first call
settings.register_profile("gimpmd", deadline=None, derandomize=True)
settings.load_profile("gimpmd")

SOUND: dict[str, Any] = {
    "gimpmd": 1,
    "name": "sound",
    "units": "lj",
    "domain": {"box": [[0, 120], [0, 80]]},
    "grid": {"cell": 4},
    "time": {"end": 8, "md_timestep": 0.002, "md_steps": 40},
    "md": {"region": [[0, 80], [20, 60]], "input": "md.in"},
    "coupling": {"scheme": "velocity"},
    "continuum": {
        "material": {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8},
    },
    "output": {"interval": 1},
}


def varied(**changes: Any) -> dict[str, Any]:
    """The sound case as plain values, with ``section__key=value`` set (``...`` removes)."""
    raw = deepcopy(SOUND)
    for path, value in changes.items():
        *parents, last = path.split("__")
        place = raw
        for parent in parents:
            place = place.setdefault(parent, {})
        if value is ...:
            del place[last]
        else:
            place[last] = value
    return raw


@pytest.fixture(scope="session")
def plain() -> Callable[..., dict[str, Any]]:
    """Plain values of the sound case with changes."""
    return varied


@pytest.fixture(scope="session")
def make() -> Callable[..., Case]:
    """The sound case with changes, as a `Case`."""
    return lambda **changes: msgspec.convert(varied(**changes), Case)
