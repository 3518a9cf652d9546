"""The scheme of a run without a continuum."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gimpmd_md.roles import BOUNDARY, CORE
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from tests.services.md.block import ALONE
from tests.services.md.driving import advance, energies, having


@pytest.mark.parametrize("scheme", ["velocity", "force"])
def test_without_a_continuum_all_atoms_are_free_and_no_fields_are_sent(
    start: Callable[[Case], MdSide], make: Callable[..., Case], scheme: str
) -> None:
    side = start(make(**ALONE, coupling__scheme=scheme, md__minimize=False))
    assert side.offers.size == side.needs.size == 0
    advance(side)
    assert side.zone_fields() == {}
    assert having(side, CORE).all()
    assert not having(side, BOUNDARY).any()
    assert energies(side).mass == len(side.atoms.x)
