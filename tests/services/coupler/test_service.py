"""The command of the coupler: what it says when it fails itself."""

from __future__ import annotations

import argparse
import json
from copy import deepcopy
from pathlib import Path

import msgspec
import pytest

from gimpmd_coupler import service
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import make_plan, write_plan
from tests.services.coupler.conftest import CASE


def test_a_coupler_that_fails_itself_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """So nobody takes a rank for the cause that ends because of it."""

    def fail(coupler: service.Coupler) -> None:
        raise MemoryError("no memory left")

    monkeypatch.setattr(service.Coupler, "run", fail)
    monkeypatch.setattr(service.signal, "signal", lambda *_: None)  # this process keeps its own
    case = msgspec.convert(deepcopy(CASE), Case)
    dump_case(case, tmp_path / "case.yaml")
    write_plan(make_plan(case), tmp_path / "plan.yaml")
    options = argparse.Namespace(
        run_dir=tmp_path, run="test", listen="", keys=None, supervised=False, deadline=10.0
    )
    with pytest.raises(MemoryError):
        service.serve(options)
    events = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    message = "MemoryError: no memory left"
    failed = {"type": "ServiceFailed", "who": "coupler", "message": message, "exit_code": 3}
    assert failed in events
