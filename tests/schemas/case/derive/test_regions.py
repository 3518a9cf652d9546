"""Boxes of atoms and patches."""

from __future__ import annotations

import math
from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.derive import regions
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.zones import patches

Make = Callable[..., Case]


@given(st.integers(1, 64), st.floats(0.1, 10))
def test_automatic_patches_use_every_rank(make: Make, ranks: int, aspect: float) -> None:
    case = make(md__ranks=ranks, md__region=[[0, 80 * aspect], [20, 60]])
    px, py = regions.md_patches(case)
    assert px * py == ranks
    assert len(patches(regions.md_region(case), (px, py))) == ranks


def test_automatic_patches_are_squarish(make: Make) -> None:
    assert regions.md_patches(make(md__ranks=2)) == (2, 1)
    assert regions.md_patches(make(md__ranks=8)) == (4, 2)
    assert regions.md_patches(make(md__ranks=8, md__patches=[8, 1])) == (8, 1)


@given(st.integers(1, 10**9))
def test_continuum_patches_use_every_rank(make: Make, ranks: int) -> None:
    for box in ([[0, 10], [0, 7]], [[0, 10], [0, 7], [0, 3]]):
        case = make(domain__box=box, continuum__ranks=ranks)
        assert math.prod(regions.continuum_patches(case)) == ranks


def test_patches_in_three_dimensions(make: Make) -> None:
    block = {"domain__box": [[0, 40], [0, 80], [0, 20]], "continuum__ranks": 8}
    assert regions.continuum_patches(make(only="continuum", **block)) == (2, 4, 1)  # cubes of 20
    atoms = make(**block, md__region=[[0, 20], [20, 60], [0, 20]], md__ranks=2)
    assert regions.md_patches(atoms) == (1, 2, 1)


def test_md_only_fills_the_domain_with_atoms(make: Make) -> None:
    assert regions.md_regions(make(only="md")) == (make().domain.box,)
    boxes = [[[0, 20], [0, 20]], [[60, 80], [40, 60]]]
    assert regions.md_region(make(md__region=..., md__regions=boxes)) == ((0.0, 80.0), (0.0, 60.0))
