"""The figure of the wall time."""

import pytest

from gimpmd_deploy.figures import wall_time


def test_bars_add_up(block, tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(wall_time, "save", lambda figure, path: figures.append(figure) or path)
    wall_time.draw_wall_time(block, tmp_path, False)
    (axes,) = figures[0].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["md", "continuum"]
    total = sum(sum(phases.values()) for phases in block.timings.totals().values())
    assert sum(bar.get_width() for bar in axes.patches) == pytest.approx(total)


def test_no_two_phases_look_alike():
    phases = [f"phase {number}" for number in range(12)]
    looks = wall_time.looks_of([*phases, "wait"])
    assert len(set(looks.values())) == 13
    assert len({looks[phase][0] for phase in phases[:7]}) == 7
