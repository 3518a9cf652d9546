"""The laws of crystals in space that LAMMPS measures, against its stress at other strains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.case.materials import MeasuredByMd
from tests.copper_sites import (
    ALUMINIUM,
    COPPER,
    COPPER_110,
    COPPER_111,
    IRON,
    MAGNESIUM,
    SILICON,
    TUNGSTEN,
    Metal,
)
from tests.physics.laws_in_space import cell_in, errors, law_of, table


def test_the_exact_stress_of_copper(tmp_path: Path) -> None:
    """LAMMPS's own up to round-off, which is larger relative to small strains."""
    law = law_of(MeasuredByMd(cell="cell.in", model="lattice-sum"), COPPER, tmp_path)
    with open_cell(*cell_in(tmp_path), dims=(3,)) as cell:
        for size, most in ((1e-4, 1e-9), (0.01, 1e-11), (0.08, 1e-11)):
            assert errors(law, cell, size, count=3).max() < most


@pytest.mark.long
def test_stress_of_copper(tmp_path: Path) -> None:
    """Medians no worse than those of an independent fit with free moduli.

    That one left 6e-4, 7e-4, 1e-3, 5e-3 and 2e-2.
    """
    found = table(COPPER, tmp_path)
    assert (found["finite"][:, 0] < [6e-4, 1e-3, 2e-3, 5e-3, 3e-2]).all()
    assert (found["finite"][:4, 1] < 0.01).all()
    assert (found["linear"][:4, 0] > 20.0 * found["finite"][:4, 0]).all()
    assert (found["exact"] < 1e-9).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("metal", "most"),
    [
        (COPPER_110, 0.02),
        (COPPER_111, 0.02),
        (ALUMINIUM, 0.01),
        (IRON, 0.05),
        (TUNGSTEN, 0.005),
        (SILICON, 5e-4),
        (MAGNESIUM, 0.1),
    ],
)
def test_stress_of_other_crystals(metal: Metal, most: float, tmp_path: Path) -> None:
    """Other orientations, and hexagonal close packing: fewer terms vanish.

    Silicon and magnesium have atoms that shift within the primitive cell.
    """
    found = table(metal, tmp_path)
    assert (found["finite"][:4, 1] < most).all()
    assert (found["finite"][:4] < found["linear"][:4]).all()
    assert (found.get("exact", np.zeros(1)) < 1e-9).all()


@pytest.mark.long
def test_a_higher_degree_is_more_accurate(tmp_path: Path) -> None:
    """Where the potential is smooth; silicon up to 2 %."""
    worst = [table(SILICON, tmp_path / str(d), d)["finite"][:3, 1].max() for d in (3, 4, 5)]
    assert worst[0] > 10.0 * worst[1] > 50.0 * worst[2]
