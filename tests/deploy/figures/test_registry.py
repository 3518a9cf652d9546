"""The figures of a run: all are drawn, and a new one needs one function."""

from pathlib import Path

import pytest

from gimpmd_deploy.figures.registry import FIGURES, draw_all, run_figure
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import InputError
from tests.deploy.figures.three_d import make_run

NAMES = {"energies.png", "wall_time.png", "sigma_yy.png"} | {
    f"sigma_yy_{index:04d}.png" for index in range(3)
}
"""Figures of the block, which has three outputs."""


def test_figures_of_finished_runs(runs):
    """``cli/test_plot.py`` draws those of the atoms alone."""
    for run in ("block", "block-continuum"):
        names = {path.name for path in (runs / run / "figures").iterdir()}
        assert names == NAMES


def test_figures_of_three_dimensions(tmp_path):
    drawn = draw_all(make_run(tmp_path))
    assert {path.name for path in drawn} == {
        "sigma_yy.png",
        "sigma_yy_0000.png",
        "energies.png",
        "wall_time.png",
    }
    assert all(path.stat().st_size > 5000 for path in drawn)


def test_a_new_figure_is_one_function(tmp_path, monkeypatch):
    monkeypatch.setattr("gimpmd_deploy.figures.registry.FIGURES", dict(FIGURES))

    @run_figure("steps")
    def draw_steps(run: Run, folder: Path, every: bool) -> list[Path]:
        (folder / "steps.txt").write_text(str(run.plan.steps))
        return [folder / "steps.txt"]

    assert tmp_path / "figures" / "steps.txt" in draw_all(make_run(tmp_path))


def test_a_run_without_output(block, tmp_path):
    for name in ("case.yaml", "plan.yaml"):
        (tmp_path / name).write_text((block.folder / name).read_text())
    with pytest.raises(InputError, match="the run recorded nothing"):
        draw_all(Run(tmp_path))
