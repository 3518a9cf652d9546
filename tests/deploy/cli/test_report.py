"""``gimpmd report``, ``plot`` and ``compare`` on a folder that is no run; ``report`` on one."""

import json

import pytest


@pytest.mark.parametrize("command", ["report", "plot", "compare"])
def test_no_run_folder(bench, command):
    folders = [bench.folder] * (2 if command == "compare" else 1)
    result = bench.gimpmd(command, *folders)
    assert result.exit_code == 2
    assert "this is not a run folder" in result.stderr
    assert str(bench.folder) in result.stderr


def test_report_as_text_and_as_json(bench, runs):
    report = json.loads(bench.gimpmd("report", runs / "block", "--json").stdout)
    assert report["outcome"] == "completed"
    text = bench.gimpmd("report", runs / "block").stdout
    for word in ("completed", "1,560 material points", "energy balance", "lammps"):
        assert word in text
    assert "remaining imbalance at the end: " in text
    assert "of the external work" in text
