"""Atoms are found by their lattice positions, also across periodic faces."""

from __future__ import annotations

import numpy as np

from gimpmd_md.engines.lammps.site_key import SiteKey
from gimpmd_schemas.case.form import Domain

DOMAIN = Domain(box=((0.0, 4.0), (0.0, 2.0)), periodic=(True, False))
SITES = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [3.0, 1.0]])


def test_atoms_are_found_in_any_order_and_up_to_round_off() -> None:
    key = SiteKey(SITES, DOMAIN, 1.0)
    rows, here = key.rows(SITES[[3, 1]] + 1e-9)
    assert rows.tolist() == [3, 1]
    assert here.all()


def test_positions_without_an_atom_are_told() -> None:
    rows, here = SiteKey(SITES, DOMAIN, 1.0).rows(np.array([[1.5, 0.0], [2.0, 1.0]]))
    assert rows.tolist() == [2]
    assert here.tolist() == [False, True]


def test_both_sides_of_a_periodic_face_are_the_same() -> None:
    key = SiteKey(SITES, DOMAIN, 1.0)
    rows, here = key.rows(np.array([[4.0, 0.0], [4.0 - 1e-12, 0.0], [0.0, 2.0]]))
    assert rows.tolist() == [0, 0]
    assert here.tolist() == [True, True, False], "the other axis is not periodic"


def test_a_rank_without_atoms() -> None:
    rows, here = SiteKey(SITES[:0], DOMAIN, 1.0).rows(SITES)
    assert rows.size == 0
    assert not here.any()
