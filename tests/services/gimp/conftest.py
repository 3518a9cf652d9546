"""Small bodies for the GIMP tests: density 1, longitudinal wave speed 1."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case


def make_case(**changes: Any) -> Case:
    """A periodic bar, 32 cells long and 2 high, run by the continuum alone."""
    data: dict[str, Any] = {
        "gimpmd": 1,
        "name": "bar",
        "units": "lj",
        "domain": {"box": [[0.0, 32.0], [0.0, 2.0]], "periodic": [True, True]},
        "grid": {"cell": 1.0},
        "time": {"end": 1.0, "md_timestep": 0.4, "md_steps": 1},
        "md": {"region": [[0.0, 32.0], [0.0, 2.0]], "input": "none.in"},
        "coupling": {"scheme": "velocity"},
        "continuum": {
            "material": {"from": "moduli", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0},
            "xpic": {"every": 0},
        },
        "output": {"interval": 1.0},
        "only": "continuum",
    }
    data.update(changes)
    return msgspec.convert(data, Case, strict=True)


@pytest.fixture
def build():
    """Function that makes a case, keys replaced by its arguments."""
    return make_case
