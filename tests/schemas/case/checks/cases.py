"""Changes of the sound case, and what is asked of a rule."""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import Case

Break = tuple[str, dict[str, Any], str]
"""Key of a problem, changes of the sound case that cause it, and a part of its message."""

LEFT = {"condition": "traction", "value": [1, 0]}
MEASURED = {"from": "md", "cell": "cell.in"}


def crack(x: float, y: float = 40.0) -> list[dict[str, Any]]:
    """A crack from the left face to a point."""
    return [{"from": [0, 40], "to": [x, y]}]


def packet(**changes: Any) -> list[dict[str, Any]]:
    """A packet with changes."""
    return [{"center": 60, "wavelength": 10, "strain": 1e-4} | changes]


def material(**changes: Any) -> dict[str, Any]:
    """The sound material with changes."""
    return {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8} | changes


def crystal(**changes: Any) -> dict[str, Any]:
    """A strain energy of degree three, which has 16 terms."""
    energy = {"from": "hyperelastic", "coefficients": [1.0] * 16, "strain_limit": 0.06}
    return material(**energy | changes)


def fitted(**changes: Any) -> dict[str, Any]:
    """A material whose energy LAMMPS measures."""
    return {"continuum__material": MEASURED | {"model": "cauchy-born"} | changes}


def plastic(**changes: Any) -> dict[str, Any]:
    """The sound material, which yields, with changes."""
    yields = {"from": "j2", "yield_stress": 0.3, "hardening": 1.0}
    return {"continuum__material": material(**yields | changes)}


def bonded(**changes: Any) -> dict[str, Any]:
    """A material of two bonds."""
    bonds = {
        "bonds": [[1, 0], [0, 1]],
        "energy": [[0, 1], [0, 1, 2]],
        "area": 1,
        "stretch_limit": 0.1,
    }
    return {"continuum__material": material(**{"from": "lattice"} | bonds | changes)}


ALONE: dict[str, Any] = {"only": "continuum", "md": ..., "time": {"end": 8}}
"""Changes that take the atoms away: what is left is 30 x 20 cells of 4."""

BLOCK = ALONE | {"domain__box": [[0, 40], [0, 40], [0, 24]]}
"""The same in three dimensions: 10 x 10 x 6 cells."""

STIFF = [[100, 30, 0], [30, 80, 0], [0, 0, 25]]
ENDS = {"from": [0, 40], "to": [60, 40]}


def levels(*boxes: list[Any]) -> dict[str, Any]:
    """A body alone with one list of boxes for each refined level."""
    return ALONE | {"grid__levels": [{"boxes": level} for level in boxes]}


def cracked(base: dict[str, Any] = ALONE, **changes: Any) -> dict[str, Any]:
    """A body alone with a crack from the left face to its middle, with changes."""
    return base | {"continuum__cracks": [ENDS | changes]}


def face(**changes: Any) -> dict[str, Any]:
    """A body alone with a condition on its left face."""
    return ALONE | {"boundary__left": changes}


def anisotropic(stiffness: list[list[float]], **more: Any) -> dict[str, Any]:
    """A material given by its stiffness, and more."""
    given = {"from": "stiffness", "density": 1, "stiffness": stiffness}
    return {"continuum__material": given | more}


FORCED = {"coupling__scheme": "force"}
FIXED = ALONE | {"continuum__configuration": "reference"}
CORRECTED = FIXED | {"continuum__dispersion": "corrected"}
SKEW = np.diag([70.0, 70, 70, 25, 25, 25]) + np.pad(np.full((3, 3), 30.0), (0, 3))
SKEW[1, 5] = SKEW[5, 1] = 8.0  # waves in the plane of y and z move along x as well
SLANTED = [[100, 30, 5], [30, 80, 5], [5, 5, 25]]  # a P wave along x moves along y as well

FORCE = {"coupling__scheme": "force"}
"""The sound case by the force scheme: interfaces right, bottom and top."""


def regions(*boxes: Any) -> dict[str, Any]:
    """Several MD regions instead of the one."""
    return {"md__region": ..., "md__regions": list(boxes)}


PAIR = ([[0, 40], [18, 58]], [[80, 120], [18, 58]])
"""Two regions, on the left and on the right face of the domain; cells are 4."""

ABSORBING = {"boundary__right": {"condition": "absorbing"}}


def planes(**changes: Any) -> dict[str, Any]:
    """The same with planes, four deep in the MD region [0, 80] x [20, 60]."""
    return FORCE | {"coupling__planes": {"right": 76, "bottom": 24, "top": 56} | changes}


# cell 4, two layers a cell: outer 4, inner 14; innermost at depth 18


def assert_breaks(case: Case, key: str, said: str) -> None:
    """The checks find a problem at a key, and every problem gives a way out."""
    found = check_case(case)
    matching = [p for p in found if p.key == key and said in p.message]
    assert matching, [str(p) for p in found]
    # a way out: a hint, or a message that says what must be
    assert all(p.hint or "must" in p.message for p in found), [str(p) for p in found]


def assert_keeps(case: Case) -> None:
    """The checks find no problem."""
    assert [str(p) for p in check_case(case)] == []
