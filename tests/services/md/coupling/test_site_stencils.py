"""Stencils of atoms that other ranks hold now: when ranks agree anew, and the sums they get."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.shape_functions import ShapeFunctions
from gimpmd_md.coupling.site_stencils import SiteStencils
from gimpmd_md.roles import BOUNDARY, CORE
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import SPINNING, block_case
from tests.services.md.coupling.test_halo import communicators, on_every_rank

PLAN = make_plan(block_case(**SPINNING, md__ranks=2, md__patches=[2, 1]))
GRID = PLAN.background_grid()
NODES = np.flatnonzero(GRID.canonical())
LEFT, RIGHT = np.array([[14.0, 15.0], [14.5, 30.0]]), np.array([[38.0, 15.0], [37.2, 31.0]])


def atoms_of(comm: Any, site: np.ndarray) -> Any:
    role = np.full(len(site), BOUNDARY, dtype=np.int32)
    return SimpleNamespace(comm=comm, site=site, role=role, migrations=0)


def test_sums_are_those_of_all_atoms_on_whatever_rank_they_are() -> None:
    ranks = [atoms_of(comm, x) for comm, x in zip(communicators(2), (LEFT, RIGHT), strict=True)]
    stencils = [SiteStencils(PLAN, atoms, BOUNDARY, NODES) for atoms in ranks]
    homes = [part.halo.nodes for part in stencils]

    def sums(rank: int) -> np.ndarray:
        rows, found = stencils[rank].find()
        out = np.zeros((GRID.size, 2))
        out[stencils[rank].halo.nodes] = stencils[rank].sums(found, np.sin(ranks[rank].site[rows]))
        return out

    x = np.concatenate([LEFT, RIGHT])
    everywhere = ShapeFunctions(GRID, NODES).marked(np.ones(4, dtype=np.int32), 1, x)[1]
    expected = np.zeros((GRID.size, 2))
    expected[NODES] = everywhere.gather(np.sin(x), NODES.size)
    for swapped in (False, True, False):
        for atoms, site in zip(ranks, (RIGHT, LEFT) if swapped else (LEFT, RIGHT), strict=True):
            atoms.site, atoms.migrations = site, atoms.migrations + 1
        for part, home, found in zip(stencils, homes, on_every_rank(sums, [0, 1]), strict=True):
            assert (part.halo.nodes.size > home.size) >= swapped
            own = part.halo.own
            np.testing.assert_allclose(found[own], expected[own], atol=1e-15)


def test_ranks_agree_only_after_atoms_have_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    atoms = atoms_of(communicators(1)[0], LEFT)
    plan = make_plan(block_case(**SPINNING))
    agreements: list[int] = []
    monkeypatch.setattr(atoms.comm, "allreduce", lambda n: agreements.append(n) or n, raising=False)
    stencils = SiteStencils(plan, atoms, BOUNDARY, NODES)
    first = stencils.find()
    assert stencils.find() is first
    assert agreements == [0]
    atoms.role = np.array([CORE, BOUNDARY], dtype=np.int32)
    atoms.migrations += 1
    np.testing.assert_array_equal(stencils.find()[0], [1])
    assert agreements == [0, 0]


def test_an_atom_outside_the_zone_of_its_role_is_an_error() -> None:
    atoms = atoms_of(communicators(1)[0], LEFT)
    few = NODES[GRID.positions()[NODES, 1] < 20.0]
    stencils = SiteStencils(make_plan(block_case(**SPINNING)), atoms, BOUNDARY, few)
    with pytest.raises(BackendError, match=r"\(14.5, 30\) touches nodes beyond"):
        stencils.find()
