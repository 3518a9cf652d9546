"""The atoms of an input for ASE."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest

from gimpmd_md.engines.ase.input import Crystal, Input
from gimpmd_md.engines.ase.structure import make_structure
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import ALONE, block_case

PERIODIC: dict[str, Any] = ALONE | {
    "domain": {"box": [[0, 26], [0, 26]], "periodic": [False, True]}
}


def plan(**changes: Any) -> Plan:
    return make_plan(block_case(**(PERIODIC | changes), md__backend="ase"))


def crystal(**changes: Any) -> Input:
    square = {"cell": (1.3, 1.3), "sites": ((0.0, 0.0),), "species": ("X",)}
    return Input("none:none", crystal=Crystal(**(square | changes)), masses={"X": 2.0})


def test_a_crystal_fills_the_region_and_its_images_are_left_out() -> None:
    atoms = make_structure(plan(), crystal(), 2.5)
    x = np.unique(atoms.positions[:, 0].round(9))
    y = np.unique(atoms.positions[:, 1].round(9))
    np.testing.assert_allclose(x, 1.3 * np.arange(21))
    np.testing.assert_allclose(y, 1.3 * np.arange(20))  # the last row is an image of the first
    assert len(atoms) == 21 * 20
    assert set(atoms.get_masses()) == {2.0}
    np.testing.assert_array_equal(atoms.pbc, [False, True, False])
    np.testing.assert_allclose(np.diag(atoms.cell), [26.0 + 5.0, 26.0, 5.0])


def test_a_third_edge_repeats_the_crystal_normal_to_the_plane() -> None:
    layers = {"cell": (1.3, 1.3, 1.4), "sites": ((0, 0, 0), (0.5, 0.5, 0.5)), "species": ("X", "X")}
    atoms = make_structure(plan(), crystal(**layers), 2.5)
    assert atoms.pbc[2]
    assert atoms.cell[2, 2] == 1.4
    np.testing.assert_allclose(np.unique(atoms.positions[:, 2]), [0.0, 0.7])


def test_several_regions_are_filled() -> None:
    regions = [[[5.2, 13.0], [0, 52]], [[26.0, 33.8], [0, 52]]]
    changes = {"domain__periodic": [False, True], "md__region": None, "md__regions": regions}
    two = make_plan(block_case(**changes, md__backend="ase"))
    x = make_structure(two, crystal(), 2.5).positions[:, 0]
    assert sorted(set(x.round(6))) == pytest.approx(
        [*np.arange(4, 11) * 1.3, *np.arange(20, 27) * 1.3]
    )


def write(positions: Any, **changes: Any) -> Input:
    ase.io.write("atoms.extxyz", ase.Atoms("Cu" * len(positions), positions, **changes))
    return Input("none:none", structure="atoms.extxyz")


def test_a_structure_is_read_with_the_masses_of_the_elements(folder: Path) -> None:
    x = [[1.0, 2.0, 0.0], [3.0, 25.0, 0.0]]
    atoms = make_structure(plan(), write(x), 2.5)
    np.testing.assert_allclose(atoms.positions, x)
    np.testing.assert_allclose(atoms.get_masses(), 63.546)


@pytest.mark.parametrize(
    ("x", "changes", "words"),
    [
        ([27.0, 0.0, 0.0], {}, r"the atom at \(27, 0\) lies outside md.region"),
        (
            [1.0, 1.0, 0.0],
            {"cell": [30, 20, 1], "pbc": [0, 1, 0]},
            "period of 20 along y, but the domain one of 26",
        ),
        (
            [1.0, 1.0, 0.0],
            {"cell": [30, 26, 1], "pbc": [1, 1, 0]},
            "periodic along x, but the domain is not",
        ),
        ([1.0, 1.0, 0.0], {"cell": [[9, 1, 0], [0, 26, 0], [0, 0, 1]]}, "must be a box along"),
    ],
)
def test_a_structure_that_does_not_fit_is_refused(
    folder: Path, x: Any, changes: dict[str, Any], words: str
) -> None:
    given = write([x], **changes)
    with pytest.raises(BackendError, match=words):
        make_structure(plan(), given, 2.5)


def test_a_file_that_cannot_be_read_and_a_species_that_is_not_there(folder: Path) -> None:
    with pytest.raises(BackendError, match=r"structure = 'none.xyz': ase.io cannot read it"):
        make_structure(plan(), Input("none:none", structure="none.xyz"), 2.5)
    odd = Input("none:none", crystal=crystal().crystal, masses={"Au": 1.0})
    with pytest.raises(BackendError, match=r"masses.Au: there is no such atom; there are X"):
        make_structure(plan(), odd, 2.5)
