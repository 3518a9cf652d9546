"""The common style of figures."""

import sys

import pytest

from gimpmd_deploy.figures.style import pyplot, save, unit_label
from gimpmd_schemas.errors import BackendError


def test_units_as_labels():
    assert unit_label("lj", "pressure") == "$\\epsilon$/$\\sigma$$^2$"
    assert unit_label("lj", "pressure", dim=3) == "$\\epsilon$/$\\sigma$$^3$"
    assert unit_label("metal", "time") == "ps"


def test_a_saved_figure_is_closed(tmp_path):
    figure = pyplot().figure()
    assert save(figure, tmp_path / "empty.png").exists()
    assert not pyplot().fignum_exists(figure.number)


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(BackendError, match=r"pip install 'gimpmd\[viz\]'"):
        pyplot()
