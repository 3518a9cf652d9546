"""The common style of figures."""

import sys

import pytest

from gimpmd_deploy.figures.style import pyplot, save, unit_label
from gimpmd_schemas.errors import BackendError, StorageError


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


def test_a_figure_that_cannot_be_written_leaves_no_part_of_it(tmp_path, monkeypatch):
    figure, path = pyplot().figure(), tmp_path / "half.png"

    def full_disk(name):
        name.write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figure, "savefig", full_disk)
    with pytest.raises(StorageError, match=r"half\.png cannot be written: No space left on device"):
        save(figure, path)
    assert not path.exists()
    assert not pyplot().fignum_exists(figure.number)
