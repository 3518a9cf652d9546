"""The gates as tests: short ones always, long ones with `make test-long`."""

from __future__ import annotations

import pytest

from tests.physics.gimp.gates import Gate
from tests.physics.interface.catalogue import gates_of
from tests.physics.interface.schemes import SCHEMES


@pytest.mark.parametrize(
    "gate",
    [
        pytest.param(g, id=g.name, marks=[pytest.mark.long] if g.long else [])
        for scheme in SCHEMES
        for g in gates_of(scheme)
    ],
)
@pytest.mark.timeout(3600)
def test_gate(gate: Gate) -> None:
    checks = gate.measure()
    assert checks
    failed = [check for check in checks if not check.passed]
    assert not failed, "\n".join(
        f"{check.what}: {check.measured:.4g}, required {check.required} ({check.source})"
        for check in failed
    )
