"""A crack that grows in a coupled run: two independent energy release rates agree.

One comes from a J-integral over the continuum around the atoms, the other from work, energies and
heat of the whole run. They share the path of the tip at most.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import gimpmd
from gimpmd import analysis
from gimpmd_schemas.case.form import Case
from tests.cases import EXAMPLE

SHIFT = "pair_modify shift yes\n"
"""Without it, each bond that breaks changes the energy by the potential at the cutoff."""

CASE = {
    "gimpmd": 1,
    "name": "growing-crack",
    "units": "lj",
    "domain": {"box": [[0, 240], [0, 224]]},
    "grid": {"cell": 4},
    "time": {"end": 50, "md_timestep": 0.002, "md_steps": 40},
    "md": {
        "region": [[0, 160], [72, 152]],
        "input": "crack.in",
        "cutoff": 2.5,
        "variables": {"crack_length": 60, "crack_plane": 112},
        "ranks": 1,
    },
    "continuum": {
        "material": {"from": "md", "model": "cauchy-born", "cell": "bulk.in"},
        "cracks": [{"from": [0, 112], "to": [60, 112]}],
    },
    "boundary": {
        "top": {"condition": "traction", "value": [0, 0.6], "ramp": 10},
        "bottom": {"condition": "traction", "value": [0, -0.6], "ramp": 10},
    },
    "output": {"interval": 0.8},
}


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_j_integral_and_the_energies_agree(tmp_path: Path) -> None:
    for name in ("crack.in", "bulk.in"):
        (tmp_path / name).write_text((EXAMPLE / name).read_text() + SHIFT)
    case = msgspec.convert(CASE, Case)
    run = gimpmd.run(case, tmp_path / "run", scripts=tmp_path)
    growth = analysis.crack_growth(run)
    resistance = analysis.crack_resistance(run)
    rates = analysis.energy_release_rate(run, growth, resistance, 6.0)
    boxes = ({}, {"width": 24.0}, {"box": ((0, 190), (50, 174)), "width": 30.0})
    J = [analysis.j_integral(run, **box).J for box in boxes]

    # before the waves of the load arrive at the MD region, nothing is released
    before = growth.time < 6.0
    assert np.abs(J[0][before]).max() < 1e-3
    # growth starts when J has reached the resistance, within what one output interval changes
    start = int(np.searchsorted(growth.time, growth.start))
    assert J[0][start] == pytest.approx(resistance, rel=0.15)
    # the tip is known to half an atom, which in a window of 6 (13 to 18 atoms) is 4 to 8 %
    growing = (growth.time > growth.start + 3.0) & (growth.time < 47.0)
    assert growing.sum() > 15
    assert rates.dynamic[growing] == pytest.approx(J[0][growing], rel=0.08)
    assert (J[0][growing] > 0.97 * resistance).all()
    for other in J[1:]:
        assert other[growing] == pytest.approx(J[0][growing], rel=0.015)
