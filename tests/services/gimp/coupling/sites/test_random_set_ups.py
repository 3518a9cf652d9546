"""Random set-ups of crystals in space: uniform strain is in balance, and no mode is negative."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.correction import BALANCED
from gimpmd_gimp.coupling.sites.modes import ROUND_OFF, SURFACE
from tests.services.gimp.coupling.sites.random_set_ups import (
    KINDS,
    LEAST_CELL,
    Kind,
    Outcome,
    draw,
    maker,
    outcome,
    outcomes,
)

AT_LEAST = 100
"""Set-ups of each crystal that are run; a few more are drawn, and may be refused."""

WRITTEN = 1e-8
"""Largest residual by the energies as they are written; the second difference of the lattice is in
it."""


def check(kind: Kind, found: Outcome, where: str) -> None:
    assert found.left < BALANCED, where
    assert found.written < WRITTEN, where
    zero = SURFACE if kind.at_face else ROUND_OFF
    assert found.lowest > -zero, where
    assert found.first > zero, where
    # at faces of the body the surface's stress may give a rotation some stiffness
    assert found.zeros == 0 or (kind.at_face and found.zeros == -1), where


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", list(KINDS))
def test_random_set_ups_are_exact_and_have_no_negative_mode(name: str, tmp_path: Path) -> None:
    ran = 0
    for kind in KINDS[name]:
        for number, found in enumerate(outcomes(name, kind, tmp_path)):
            if not found.refused:
                check(kind, found, f"{name}, {kind}, number {number}: {found}")
                ran += 1
    assert ran >= AT_LEAST


def test_a_soft_correction_of_a_column_would_be_seen(tmp_path: Path) -> None:
    """The test above can fail: it does with points that are softened a hundredfold."""
    kind = Kind("{100}", 2, "box", 1)
    with maker("Cu", kind.axes, tmp_path) as made:
        setup = draw(kind, *made, LEAST_CELL["Cu"], np.random.default_rng(6))
    found = outcome(kind, setup)
    check(kind, found, f"{found}")
    stronger = replace(setup.correction, dA=100.0 * setup.correction.dA)
    setup.__dict__["correction"] = stronger
    assert np.linalg.eigvalsh(setup.hessian())[0] < 0.0
