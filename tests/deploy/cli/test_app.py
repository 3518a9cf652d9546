"""The command as a whole."""

import signal
import sys

import pytest

from gimpmd_deploy.cli import app as module
from gimpmd_schemas.errors import STOPPED


@pytest.mark.parametrize(
    "words",
    ["run", "up", "validate", "plot", "report", "compare", "strain dump", "verify interface"],
)
def test_every_command_has_help(bench, words):
    result = bench.gimpmd(*words.split(), "--help")
    assert result.exit_code == 0
    assert f"gimpmd {words} [OPTIONS]" in result.output


@pytest.mark.parametrize(("code", "expected"), [(130, STOPPED), (2, 2), (0, 0)])
def test_an_interrupt_before_a_command_begins_counts_as_a_stop(
    code: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "app", lambda: sys.exit(code))
    monkeypatch.setattr(module, "outlive_readers", lambda: None)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as end:
        module.main()
    assert end.value.code == expected
