"""The figure of reflection and transmission."""

from __future__ import annotations

from gimpmd_deploy.figures import crossing
from gimpmd_deploy.verify.strips import Wave
from gimpmd_deploy.verify.tasks import Task
from gimpmd_deploy.verify.verdict import judge
from tests.deploy.verify.crystal import HEXAGONAL, ground


def test_lines_of_straight_waves_and_marks_of_oblique_ones(tmp_path, monkeypatch) -> None:
    figures = []
    monkeypatch.setattr(crossing, "save", lambda figure, path: figures.append(figure) or path)
    shares = {}
    for wave in (Wave(8.0, "P"), Wave(12.0, "P"), Wave(8.0, "P", 30.0)):
        for travel in ("into", "out"):
            shares[Task(wave, travel)] = (0.1, 0.9)
        shares[Task(wave, "into", "continuum")] = (0.0, 1.0)
    crossing.draw_crossing(judge(ground(HEXAGONAL), shares), tmp_path / "interface.png")
    transmitted = figures[0].axes[0]
    lines = {line.get_label(): line for line in transmitted.lines}
    assert set(lines) == {
        "into the atoms",
        "into the atoms, 30 degrees",
        "out of the atoms",
        "out of the atoms, 30 degrees",
        "continuum only",
    }
    assert lines["into the atoms"].get_xdata().tolist() == [8.0, 12.0]
    assert lines["continuum only"].get_ydata().tolist() == [1.0, 1.0]
