"""``gimpmd plot``."""

import shutil
from pathlib import Path


def test_plot_draws_again(bench, runs, tmp_path):
    run = tmp_path / "again"
    shutil.copytree(runs / "block-md", run)
    shutil.rmtree(run / "figures")
    result = bench.gimpmd("plot", run)
    assert result.exit_code == 0, result.output
    drawn = [Path(line) for line in result.stdout.split()]
    assert sorted(drawn) == sorted((run / "figures").iterdir())
    assert run / "figures" / "energies.png" in drawn
