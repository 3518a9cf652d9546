"""The gates as tests: short ones always, long ones with `make test-long`."""

from __future__ import annotations

import pytest

from gimp.catalogue import GATES
from gimp.gates import Gate


@pytest.mark.parametrize(
    "gate",
    [pytest.param(g, id=g.name, marks=[pytest.mark.long] if g.long else []) for g in GATES],
)
def test_gate(gate: Gate) -> None:
    failed = [check for check in gate.measure() if not check.passed]
    assert not failed, "\n".join(
        f"{check.what}: {check.measured:.4g}, required {check.required} ({check.source})"
        for check in failed
    )
