"""What the MD service writes of the stiffness of its atoms."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md import stiffness
from gimpmd_md.crystal.inner_shift import of_plan, shifts
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.elasticity import unit_strains
from gimpmd_schemas.wire.answers import FreeAtoms
from gimpmd_schemas.wire.stiffness import Stiffness
from tests.sites_case import CELL, SCRIPT, measured_case

TWO = {
    "domain.box": [[0.0, 26 * CELL], [0.0, 14 * CELL]],
    "md.region": None,
    "md.regions": [
        [[2.6 * CELL, 11.2 * CELL], [2.8 * CELL, 11.3 * CELL]],
        [[14.3 * CELL, 23.1 * CELL], [2.7 * CELL, 11.1 * CELL]],
    ],
}
"""Two regions, with a case of the tests for one."""

SCRIPT_OF_TWO = SCRIPT.replace(
    "create_atoms 1 region box\n",
    """\
region one block ${xlo1} ${xhi1} ${ylo1} ${yhi1} -0.5 0.5 units box
region two block ${xlo2} ${xhi2} ${ylo2} ${yhi2} -0.5 0.5 units box
region both union 2 one two
create_atoms 1 region both
""",
)


def stiffness_of(case: Case, folder: Path) -> Stiffness:
    """As the MD service writes it."""
    here = Path.cwd()
    os.chdir(folder)  # scripts are read in the working directory
    try:
        said = stiffness.measure(case, MPI.COMM_SELF, folder, folder / "stiffness.npz")
    finally:
        os.chdir(here)
    found = Stiffness.load(folder / "stiffness.npz")
    assert said == FreeAtoms(freedoms=found.x.size)
    return found


def check_strain(case: Case, found: Stiffness, m: int, H: np.ndarray) -> None:
    """Under a gradient H with the strain m its forces are those that were measured directly."""
    sites = case.coupling.sites
    assert sites is not None
    grid, dim, n = make_plan(case).background_grid(), case.dim, found.x.size
    kappa = of_plan(sites).at(found.x)
    moved = found.x @ H.T + shifts(kappa, np.broadcast_to(H, (len(kappa), dim, dim)))
    u = np.concatenate([moved, grid.positions() @ H.T]).ravel()
    force = -(found.matrix @ u)
    wanted = np.zeros((grid.size, dim))
    wanted[list(sites.nodes)] = np.frombuffer(sites.force).reshape(-1, len(sites.nodes), dim)[1 + m]
    size = np.abs(wanted).max()
    assert size > 0.0
    np.testing.assert_allclose(force[n:], wanted.ravel(), atol=1e-6 * size)
    np.testing.assert_allclose(force[:n], 0.0, atol=1e-6 * size)


def test_strained_nodes_have_the_forces_that_were_measured(tmp_path: Path) -> None:
    case = measured_case(tmp_path, SCRIPT_OF_TWO, **TWO)
    found = stiffness_of(case, tmp_path)
    for m, H in enumerate(unit_strains(2)):
        check_strain(case, found, m, H)


def test_no_file_is_written_for_too_many_atoms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = measured_case(tmp_path)
    monkeypatch.setattr(stiffness, "MOST", {2: 283})
    monkeypatch.chdir(tmp_path)
    said = stiffness.measure(case, MPI.COMM_SELF, tmp_path, tmp_path / "s.npz")
    assert said == FreeAtoms(freedoms=284)
    assert not (tmp_path / "s.npz").exists()
