"""Places of the planes of the sites scheme."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.crystal.plane_pairs import SHARES
from gimpmd_schemas.case.form import FACES
from gimpmd_schemas.errors import BackendError
from tests.sites_case import CELL, SCRIPT, A, measured_case

LAYERS = (0.5 * A, 0.5 * 3.0**0.5 * A)
CUTOFF = 2.5


def test_planes_follow_the_rule_and_hold_all_ghosts(tmp_path: Path) -> None:
    case = measured_case(tmp_path)
    first, sites = case.coupling.planes, case.coupling.sites
    assert sites is not None
    (second,) = sites.second
    for k, face in enumerate(FACES[:4]):
        axis, out = k // 2, (-1.0, 1.0)[k % 2]
        one, two = getattr(first, face), getattr(second, face)
        layers = (two - one) * out / LAYERS[axis]
        assert layers == pytest.approx(round(layers), abs=1e-9)
        assert (layers + 1.0) * LAYERS[axis] > CUTOFF
        assert (one * out / CELL) % 1.0 == pytest.approx(
            np.clip((one * out / CELL) % 1.0, 1.0 - SHARES[1], 1.0 - SHARES[0])
        )
        end = case.atoms.boxes()["md.region"][axis][k % 2]
        assert CUTOFF <= (end - two) * out < CUTOFF + 2.0 * CELL
    assert sites.period == pytest.approx((A, 3.0**0.5 * A))


@pytest.mark.parametrize(
    "region",
    [((0.0, 9.2), (2.8, 12.9)), ((0.0, 9.2), (0.0, 9.0))],
    ids=["left face", "corner"],
)
def test_layers_at_a_face_of_the_body_are_even(
    region: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    """In a corner: of both planes the outermost layer reaches the face, or of neither."""
    changes = {"md.region": [[low * CELL, high * CELL] for low, high in region]}
    sites = measured_case(tmp_path, **changes).coupling.sites
    assert sites is not None
    second = np.array(sites.second[0].limits(2)) / np.array(LAYERS)[:, None]
    low, high = np.rint(second).T
    assert np.isneginf(low[0])
    assert (high[1] - low[1] if np.isfinite(low[1]) else high[0] - high[1]) % 2 == 0


SQUARE = SCRIPT.replace(
    f"variable density equal 2.0/({A}^2*sqrt(3.0))\nlattice hex ${{density}} origin 0.25 0.25",
    "lattice sq 1.0 origin 0.3 0.3",
)
"""A crystal with layers one apart; cells must be as large, so that most hold one layer."""


def is_refused(folder: Path, cell: float, count: int, left: float) -> str:
    """What is said of a region whose left face is at some place; empty if it has planes."""
    changes = {
        "grid.cell": cell,
        "domain.box": [[0.0, count * cell]] * 2,
        "md.region": [[left, 44.128], [10.976, 44.24]],
        "time.md_timestep": 0.001,
        "time.md_steps": 4,
    }
    try:
        measured_case(folder, SQUARE, **changes)
    except BackendError as error:
        return str(error)
    return ""


NONE = (
    r"md\.region: no plane .* near its left face, at .*, leaves 0\.05 to 0\.7 of its cell to .*: "
)


def test_a_face_without_planes_is_refused_with_what_works(tmp_path: Path) -> None:
    """Nearest are a place and cells; both are tried here, and a place that is a little nearer."""
    left, cell = 11.648, 1.12
    ways = NONE + r"move it to (\S+), or use grid\.cell: (\S+)$"
    said = re.match(ways, is_refused(tmp_path, cell, 50, left))
    assert said is not None
    place, size = map(float, said.groups())
    assert is_refused(tmp_path, cell, 50, place) == ""
    nearer = place + 0.02 * cell * (1.0 if place < left else -1.0)
    assert re.match(NONE, is_refused(tmp_path, cell, 50, nearer))
    assert is_refused(tmp_path, size, 51, left) == ""


def test_planes_at_the_same_share_of_all_cells_need_other_cells(tmp_path: Path) -> None:
    said = is_refused(tmp_path, 1.0, 56, 10.4)
    assert re.match(NONE + r"use grid\.cell: 1\.037037037$", said)
    assert is_refused(tmp_path, 56.0 / 54.0, 54, 10.4) == ""
