"""The crystal, the ghosts, the continuum and its correction together have no negative mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.correction import BALANCED, check_moduli
from gimpmd_gimp.coupling.sites.modes import ROUND_OFF, SURFACE
from gimpmd_schemas.grid.zones import Box
from tests.copper_sites import SILICON
from tests.services.gimp.coupling.sites.crystals import (
    Crystal,
    copper,
    embedded,
    lennard_jones,
)
from tests.services.gimp.coupling.sites.interfaces import Setup, by_the_rule, silicon
from tests.services.gimp.coupling.sites.test_correction import BOX, L


def spectrum(setup: Setup) -> np.ndarray:
    """Eigenvalues over the largest, ascending."""
    values = np.linalg.eigvalsh(setup.hessian())
    return np.asarray(values / values[-1])


def check(setup: Setup, zero: float = ROUND_OFF) -> None:
    """There are the rigid motions, and no other mode without stiffness."""
    check_moduli(setup.correction, setup.stiffness)
    values, d = spectrum(setup), setup.crystal.dim
    assert values[0] > -zero
    assert (values < zero).sum() == d * (d + 1) // 2


@pytest.mark.parametrize("boxes", [BOX, L], ids=["box", "L"])
def test_only_rigid_motions_are_free(boxes: list[Box]) -> None:
    check(by_the_rule(lennard_jones(), 3.856, boxes))


def random_boxes(kind: str, cell: float, rng: np.random.Generator) -> list[Box]:
    """One box, an L, or two boxes with a gap."""
    (x0, y0), (dx, dy) = rng.uniform(-6.0, -3.0, 2), rng.uniform(6.0, 15.0, 2)
    box: Box = ((x0, x0 + dx), (y0, y0 + dy))
    if kind == "L":
        wide, tall = rng.uniform(5.0, 8.0, 2)
        return [
            ((x0, x0 + dx + 8.0), (y0, y0 + tall)),
            ((x0, x0 + wide), (y0, y0 + dy + 8.0)),
        ]
    if kind == "pair":
        gap = 5.0 + cell * rng.uniform(4.5, 6.0)
        start = x0 + dx + gap
        return [box, ((start, start + rng.uniform(6.0, 12.0)), (y0 + 2.0, y0 + dy + 3.0))]
    return [box]


INF = np.inf
AT_FACE: list[Box] = [((-INF, 9.0), (-8.0, 9.8))]
IN_CORNER: list[Box] = [((-INF, 12.0), (-INF, 12.0))]


@pytest.mark.parametrize("make", [lennard_jones, embedded])
@pytest.mark.parametrize("boxes", [AT_FACE, IN_CORNER], ids=["face", "corner"])
def test_planes_that_end_at_faces_have_no_negative_mode(
    make: Callable[[], Crystal], boxes: list[Box]
) -> None:
    check(by_the_rule(make(), 3.856, boxes), SURFACE)


@pytest.mark.long
@pytest.mark.parametrize("number", range(34))
@pytest.mark.parametrize("kind", ["face", "corner"])
@pytest.mark.parametrize("make", [lennard_jones, embedded])
def test_no_random_set_up_at_faces_has_a_negative_mode(
    make: Callable[[], Crystal], kind: str, number: int
) -> None:
    """With even and with odd numbers of layers."""
    rng = np.random.default_rng(300 + number)
    cell = float(rng.choice([2.57, 3.0, 3.856, 4.3, 5.1]))
    x, y = rng.uniform(7.0, 14.0, 2)
    low = -INF if kind == "corner" else rng.uniform(-9.0, -6.0)
    setup = by_the_rule(make(), cell, [((-INF, x), (low, y))])
    assert setup.correction.left < BALANCED
    check(setup, SURFACE)


@pytest.mark.long
@pytest.mark.parametrize("number", range(34))
@pytest.mark.parametrize("kind", ["box", "L", "pair"])
def test_no_random_set_up_has_a_negative_mode(kind: str, number: int) -> None:
    rng = np.random.default_rng(100 + number)
    cell = float(rng.choice([2.57, 3.0, 3.856, 4.3, 5.1]))
    setup = by_the_rule(lennard_jones(), cell, random_boxes(kind, cell, rng))
    assert setup.correction.left < 1e-9
    check(setup)


@pytest.mark.long
def test_copper_at_a_face_has_no_negative_mode() -> None:
    crystal = copper()
    a = crystal.cell[0]
    setup = by_the_rule(crystal, 2.5 * a, [((-1.6 * a, 1.6 * a), (-1.6 * a, 1.6 * a), (-INF, a))])
    check(setup, SURFACE)


@pytest.mark.long
def test_copper_has_no_negative_mode() -> None:
    crystal = copper()
    a = crystal.cell[0]
    check(by_the_rule(crystal, 2.5 * a, [((-1.6 * a, 1.6 * a),) * 3]))


@pytest.mark.long
@pytest.mark.parametrize("number", range(6))
def test_silicon_is_exact_and_has_no_negative_mode(number: int, tmp_path: Path) -> None:
    """A crystal with two atoms in its cell; LAMMPS gives forces and their derivatives."""
    rng = np.random.default_rng(500 + number)
    a, period = SILICON.constant, float(rng.choice([1.2, 1.5, 2.0]))
    low, size = rng.uniform(-1.2, -0.8, 3) * a, rng.uniform(1.8, 2.6, 3) * a
    with silicon(tmp_path) as (made, _):
        setup = made(None, period * a, [tuple(zip(low, low + size, strict=True))])
        assert setup.correction.left < BALANCED
        check(setup)


def test_a_soft_correction_would_be_seen() -> None:
    """The test above can fail: it does with points that are softened a hundredfold."""
    setup = by_the_rule(lennard_jones(), 3.856, BOX)
    stronger = replace(setup.correction, dA=100.0 * setup.correction.dA)
    setup.__dict__["correction"] = stronger
    assert spectrum(setup)[0] < -ROUND_OFF
