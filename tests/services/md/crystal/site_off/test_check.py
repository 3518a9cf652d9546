"""Sites that are off have no energy; free atoms feel the whole crystal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.crystal.site_off.check import agreement, check
from gimpmd_md.engines.lammps.site_off import setfl
from gimpmd_schemas.errors import BackendError
from tests.services.md.crystal.site_off.crystals import SAMPLES, crystal, near_one_end


def strains(dim: int) -> list[np.ndarray]:
    """No strain, 1 % along x, and a random strain of 2 %."""
    random = np.triu(np.random.default_rng(3).normal(size=(dim, dim)))
    random *= 0.02 / np.linalg.norm(random)
    return [np.eye(dim), np.diag([1.01, *[1.0] * (dim - 1)]), np.eye(dim) + random]


@pytest.mark.parametrize("name", SAMPLES)
def test_energy_and_forces_are_those_of_the_whole_crystal(name: str, tmp_path: Path) -> None:
    sample = SAMPLES[name]
    with crystal(sample, tmp_path) as cell:
        off = near_one_end(cell, 0.25)
        for F in strains(sample.dimension):
            found = agreement(cell, off, 1, F)
            assert found.free > 0.05 * len(cell.engine.atoms("id"))
            assert abs(found.energy) < 1e-11
            assert found.force < 1e-11
        check(cell, off, 1, strains(sample.dimension))


def test_a_wrong_potential_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Densities of sites that are off are left out: neighbours that are on miss them."""
    right = setfl.with_off_sites

    def wrong(tables: setfl.Tables) -> setfl.Tables:
        doubled = right(tables)
        doubled.rho[1] = 0.0
        return doubled

    monkeypatch.setattr(setfl, "with_off_sites", wrong)
    with (
        crystal(SAMPLES["Cu eam"], tmp_path) as cell,
        pytest.raises(BackendError, match="cannot be switched off"),
    ):
        check(cell, near_one_end(cell, 0.25), 1, [np.eye(3)])
