"""The gates as tests: short ones always, long ones with `make test-long`."""

from __future__ import annotations

import sys

import pytest

import tests.physics.gimp.__main__ as command
from tests.physics.gimp.catalogue import GATES
from tests.physics.gimp.gates import Check, Gate


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


@pytest.mark.parametrize(("measured", "code"), [(0.5, 0), (1.5, 1), (float("nan"), 1)])
def test_command_fails_with_a_gate(measured, code, monkeypatch, capsys) -> None:
    gate = Gate("one", False, lambda: [Check("value", measured, high=1.0)])
    monkeypatch.setattr(command, "GATES", [gate])
    monkeypatch.setattr(sys, "argv", ["gimp"])
    assert command.main() == code
    assert ("FAIL" in capsys.readouterr().out) == bool(code)
