"""A body under the displacement of a crack tip has the stress intensity factor that it is given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

import gimpmd
from gimpmd_schemas.case.form import Case

K1, SIDE, LAME, SHEAR = 0.01, 64.0, 1.5, 1.0


def cracked(cell: float) -> dict[str, Any]:
    """A square with a crack from its left face to its middle, loaded slowly and damped."""
    middle = SIDE / 2
    field = {"profile": "k-field", "k1": K1, "tip": [middle, middle]}
    face = {"condition": "displacement", "ramp": 80.0, "value": field}
    mouth = [[[0, middle - 4]], [[middle + 4, SIDE]]]
    return {
        "gimpmd": 1,
        "name": "k-field",
        "units": "lj",
        "only": "continuum",
        "domain": {"box": [[0, SIDE], [0, SIDE]]},
        "grid": {"cell": cell},
        "time": {"end": 160.0},
        "continuum": {
            "material": {"from": "moduli", "density": 1.0, "lame": LAME, "shear": SHEAR},
            "cracks": [{"from": [0, middle], "to": [middle, middle], "j_radius": 12}],
            "damping": [{"rate": 0.15}],
            "configuration": "reference",
        },
        "boundary": {
            **dict.fromkeys(("top", "bottom", "right"), face),
            "left": [face | {"extent": extent} for extent in mouth],
        },
        "output": {"interval": 80.0},
    }


@pytest.mark.parametrize("cell", [2.0, pytest.param(1.0, marks=pytest.mark.long)])
def test_factor_and_energy_release_rate(cell: float, tmp_path: Path) -> None:
    """Errors fall as the cell: of K 1.0, 0.55, 0.26 % with cells 2, 1, 0.5, of J twice that."""
    run = gimpmd.run(msgspec.convert(cracked(cell), Case), tmp_path / "run")
    nu = LAME / (2.0 * (LAME + SHEAR))
    plane_modulus = 2.0 * SHEAR / (1.0 - nu)
    tips = (run.folder / "fields" / "tips.csv").read_text().splitlines()
    last = dict(zip(tips[0].split(","), map(float, tips[-1].split(",")), strict=True))
    most = 0.006 * cell
    assert last["K_I"] == pytest.approx(K1, rel=most)
    assert abs(last["K_II"]) < 1e-3 * K1
    assert last["J"] == pytest.approx(K1**2 / plane_modulus, rel=2.0 * most)
