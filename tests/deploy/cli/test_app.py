"""The command as a whole."""

import pytest


@pytest.mark.parametrize(
    "words",
    ["run", "up", "validate", "plot", "report", "compare", "strain dump", "verify interface"],
)
def test_every_command_has_help(bench, words):
    result = bench.gimpmd(*words.split(), "--help")
    assert result.exit_code == 0
    assert f"gimpmd {words} [OPTIONS]" in result.output
