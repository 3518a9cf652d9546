"""A plate with an edge crack against NairnMPM, a material point code by other authors.

``data/nairnmpm_plate.csv`` holds what NairnMPM found with cells of 4, 2 and 1, and says how it
was run. The bound comes from NairnMPM alone: the change of its result when the cell is halved,
which is less than its discretisation error. Under the load of 0.3 (strains near 1 %) the two
codes, which take finite strain differently, must agree within that change. Under 0.003 both solve
the same linear equations by the same discretisation, and must agree within a tenth of it.
"""

from __future__ import annotations

import csv
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.setup import make_solver
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan

DATA = Path(__file__).with_name("data") / "nairnmpm_plate.csv"
LAME = SHEAR = 27.83
SIDE, SQUARE = 128.0, 4.0
SHARE = {0.3: 1.0, 0.003: 0.1}
QUANTITIES = {"displacement": ("ux", "uy"), "opening": ("opening",), "sigma_yy": ("sigma_yy",)}


def plate(cell, load):
    """The case: traction on top and bottom, a crack that ends a hair before a node."""
    pull = {"condition": "traction", "ramp": 10.0}
    data = {
        "gimpmd": 1,
        "name": "plate",
        "units": "lj",
        "domain": {"box": [[0.0, SIDE], [0.0, SIDE]]},
        "grid": {"cell": cell, "points_per_axis": 2},
        "time": {"end": 24.0, "md_timestep": 0.025 * cell, "md_steps": 1},
        "md": {"region": [[0.0, SIDE], [0.0, SIDE]], "input": "none.in"},
        "continuum": {
            "material": {"from": "moduli", "density": 0.9318, "lame": LAME, "shear": SHEAR},
            "integrator": "usavg",
            "interpolation": "ugimp",
            "xpic": {"every": 0},
            "cracks": [{"from": [0.0, 64.0], "to": [39.999, 64.0]}],
        },
        "boundary": {
            "top": {**pull, "value": [0.0, load]},
            "bottom": {**pull, "value": [0.0, -load]},
        },
        "output": {"interval": 1.0},
        "only": "continuum",
    }
    return msgspec.convert(data, Case, strict=True)


def displacement(points, cell, x, y):
    """Mean displacement of the four points around the node (x, y)."""
    around = (np.abs(points.reference - (x, y)) < 0.5 * cell).all(axis=1)
    assert around.sum() == 4
    return (points.x - points.reference)[around].mean(axis=0)


def opening(points, cell, x, y):
    """Jump of uy across the crack, each side carried linearly from its two nearest rows."""
    X, Y = points.reference.T
    u = points.x[:, 1] - Y

    def side(sign):
        rows = [
            u[(np.abs(X - x) < 0.5 * cell) & (np.abs(Y - y - sign * share * cell) < 0.1 * cell)]
            for share in (0.25, 0.75)
        ]
        assert [row.size for row in rows] == [2, 2]
        return 1.5 * rows[0].mean() - 0.5 * rows[1].mean()

    return side(1.0) - side(-1.0)


def stress_yy(points):
    """Mean sigma_yy of the points in each square, shape ``(32, 32)``."""
    stress = LAME * (points.strain[:, 0] + points.strain[:, 1])
    stress += 2.0 * SHEAR * points.strain[:, 1]
    edges = np.arange(0.0, SIDE + 1.0, SQUARE)
    X, Y = points.reference.T
    total, _, _ = np.histogram2d(X, Y, bins=(edges, edges), weights=stress)
    count, _, _ = np.histogram2d(X, Y, bins=(edges, edges))
    return total / count


def measured(rows, cell, load):
    """What gimpmd finds for every row of the data: histories in the order of time, then stress."""
    solver, found = make_solver(make_plan(plate(cell, load))), []
    for row in (row for row in rows if row["quantity"] != "sigma_yy"):
        time, x, y = float(row["time"]), float(row["x"]), float(row["y"])
        while solver.time < time - 1e-6:
            solver.step()
        assert solver.time == pytest.approx(time)
        if row["quantity"] == "opening":
            found.append(opening(solver.points, cell, x, y))
        else:
            component = ("ux", "uy").index(row["quantity"])
            found.append(displacement(solver.points, cell, x, y)[component])
    squares = stress_yy(solver.points)
    for row in (row for row in rows if row["quantity"] == "sigma_yy"):
        found.append(squares[int(float(row["x"]) / SQUARE), int(float(row["y"]) / SQUARE)])
    return np.array(found)


@pytest.mark.parametrize("load", sorted(SHARE))
@pytest.mark.parametrize("cell", [4, 2])
def test_the_plate_agrees_with_nairnmpm(cell, load):
    lines = [line for line in DATA.read_text().splitlines() if not line.startswith("#")]
    rows = [row for row in csv.DictReader(lines) if float(row["load"]) == load]
    kind = np.array([row["quantity"] for row in rows])
    foreign = {h: np.array([float(row[f"h{h}"]) for row in rows]) for h in (4, 2, 1)}
    ours = measured(rows, float(cell), load)

    for name, parts in QUANTITIES.items():
        chosen = np.isin(kind, parts)
        scale = np.linalg.norm(foreign[1][chosen])
        apart = np.linalg.norm((ours - foreign[cell])[chosen]) / scale
        change = np.linalg.norm((foreign[cell] - foreign[cell // 2])[chosen]) / scale
        print(f"load {load}, h = {cell}, {name}: apart {apart:.6f}, refinement {change:.6f}")
        assert apart < SHARE[load] * change, name
