"""What kind of potential a calculator is, and its forces."""

from __future__ import annotations

from typing import Any

import ase
import numpy as np
import pytest
from ase.build import bulk
from ase.calculators.emt import EMT
from ase.calculators.lj import LennardJones
from ase.calculators.morse import MorsePotential

from gimpmd_md.engines.ase.potential import Potential, check_range, is_pairwise
from gimpmd_schemas.errors import BackendError

COPPER = bulk("Cu", cubic=True) * (2, 2, 2)


def lennard_jones() -> Any:
    return LennardJones(sigma=2.3, epsilon=0.4, rc=5.0)


@pytest.mark.parametrize(
    ("calculator", "expected"),
    [
        (lennard_jones(), True),
        (MorsePotential(r0=2.5, rcut1=4.0, rcut2=5.0), True),
        (EMT(), False),
    ],
    ids=["Lennard-Jones", "Morse", "effective medium"],
)
def test_sums_over_pairs_are_recognized(calculator: Any, expected: bool) -> None:
    assert is_pairwise("in.yaml", COPPER, calculator, 5.0) == expected


def test_a_cutoff_that_is_too_small_is_refused() -> None:
    check_range("in.yaml", COPPER, lennard_jones(), 5.0)
    with pytest.raises(BackendError, match=r"two atoms Cu and Cu at a distance of 4.5004"):
        check_range("in.yaml", COPPER, lennard_jones(), 4.5)


def test_forces_and_energies_do_not_depend_on_the_place_of_the_body() -> None:
    """Atoms with large coordinates along an axis without period, and wrapped ones along another."""
    atoms = ase.Atoms("Cu4", np.random.default_rng(2).uniform(0, 4, (4, 3)))
    atoms.set_cell([12.0, 9.0, 30.0])
    atoms.set_pbc([False, True, False])
    potential, x = Potential("in.yaml", atoms, lennard_jones()), atoms.positions
    potential.move(x[:, :2])
    f, e = potential.forces().copy(), potential.energies().copy()
    potential.move(x[:, :2] + [1000.0, 9.0])
    np.testing.assert_allclose(potential.forces(), f, atol=1e-9 * np.abs(f).max())
    np.testing.assert_allclose(potential.energies(), e, rtol=1e-9)
    assert potential.energy() == pytest.approx(e.sum())
