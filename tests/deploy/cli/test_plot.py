"""``gimpmd plot``."""

import errno
import os
import shutil
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tests.deploy.figures.test_registry import NAMES


@pytest.fixture
def again(runs, tmp_path):
    """A copy of a finished run without its figures."""
    run = tmp_path / "again"
    shutil.copytree(runs / "block-md", run)
    shutil.rmtree(run / "figures", ignore_errors=True)
    return run


def test_plot_draws_again(bench, again):
    result = bench.gimpmd("plot", again)
    assert result.exit_code == 0, result.output
    drawn = [Path(line) for line in result.stdout.split()]
    assert sorted(drawn) == sorted((again / "figures").iterdir())
    assert {path.name for path in drawn} == NAMES


def test_fields_at_a_time(bench, again):
    options = ("--field", "sigma_xx", "--field", "von_mises", "--time", 0.4)
    result = bench.gimpmd("plot", again, *options)
    assert result.exit_code == 0, result.output
    names = {path.name for path in (again / "figures").iterdir()}
    assert names == {"sigma_xx_0001.png", "von_mises_0001.png"}


def test_a_field_that_the_run_does_not_have(bench, again):
    result = bench.gimpmd("plot", again, "--field", "level")
    assert result.exit_code == 2
    assert "--field = 'level': the run has no such field" in result.stderr
    assert "it has sigma_xx, sigma_yy, sigma_xy, pressure, von_mises" in result.stderr
    assert not (again / "figures").exists()


def test_a_full_disk_is_one_clear_error(bench, again, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Figure, "savefig", full)
    result = bench.gimpmd("plot", again, "--field", "sigma_xx", "--time", 0.4)
    assert result.exit_code == 3
    said = "sigma_xx_0001.png cannot be written: No space left on device"
    assert said in result.stderr.replace("\n", "")
    assert "internal error" not in result.stderr
    assert not list((again / "figures").iterdir())
