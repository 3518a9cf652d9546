"""The figure of the energies."""

import pytest

from gimpmd_deploy.figures import energies


def test_lines_of_both_sides(block, tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(energies, "save", lambda figure, path: figures.append(figure) or path)
    assert energies.draw_energies(block, tmp_path, False) == [tmp_path / "energies.png"]
    upper, lower = figures[0].axes
    labels = [line.get_label() for line in upper.lines]
    assert labels == [
        "kinetic, atoms",
        "potential, atoms",
        "kinetic, continuum",
        "potential, continuum",
        "total",
        "external work",
    ]
    assert "% of external work" in lower.get_ylabel()
    largest = abs(lower.lines[1].get_ydata()).max() / 100
    assert largest == pytest.approx(block.energies.largest_imbalance())
