"""The energy balance of the whole body."""

from __future__ import annotations

import math

import msgspec
import pytest

from gimpmd_coupler.ledger import Ledger
from gimpmd_schemas.wire.energies import Energies

REST = Energies(
    kinetic=0.0,
    potential=0.0,
    external_work=0.0,
    interface_work=0.0,
    dissipated=0.0,
    mass=1.0,
    momentum=(0.0, 0.0),
)


def side(**values: float) -> Energies:
    return msgspec.structs.replace(REST, **values)


def test_from_rest_the_balance_is_that_of_the_paper() -> None:
    ledger = Ledger()
    assert ledger.add([REST, REST]).balance == 0.0
    total = ledger.add(
        [
            side(kinetic=1.0, potential=2.0, external_work=3.0),
            side(kinetic=2.0, potential=3.5, external_work=7.0),
        ]
    )
    assert total.energy == 8.5
    assert total.external_work == 10.0
    assert total.balance == pytest.approx((10.0 - 8.5) / 10.0)


def test_without_work_the_balance_is_relative_to_the_energy_at_the_start() -> None:
    ledger = Ledger()
    ledger.add([side(kinetic=3.0, potential=1.0)])
    assert ledger.add([side(kinetic=2.0, potential=1.0)]).balance == pytest.approx(0.25)


def test_work_of_fixes_is_not_missing() -> None:
    ledger = Ledger()
    ledger.add([side()])
    total = ledger.add([side(kinetic=3.0, external_work=1.0, fix_work=2.0)])
    assert (total.external_work, total.fix_work) == (1.0, 2.0)
    assert total.balance == 0.0


def test_dissipated_energy_is_not_missing() -> None:
    ledger = Ledger()
    ledger.add([side(kinetic=4.0)])
    total = ledger.add([side(kinetic=3.0, dissipated=1.0)])
    assert total.dissipated == 1.0
    assert total.balance == 0.0


def test_a_step_at_which_a_side_has_no_energies_has_no_total() -> None:
    """With several grid levels, the continuum has energies only when all levels stand together."""
    ledger = Ledger()
    ledger.add([side(kinetic=1.0), side(kinetic=2.0)])
    between = ledger.add([side(kinetic=1.0), None])
    assert math.isnan(between.energy)
    assert math.isnan(between.balance)
    after = ledger.add([side(kinetic=1.5), side(kinetic=1.5)])
    assert after.energy == 3.0
    assert after.balance == 0.0
