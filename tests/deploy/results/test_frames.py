"""DataFrames where pandas is installed, and a clear error otherwise."""

import sys

import numpy as np
import pytest

from gimpmd_deploy.results.frames import dataframe
from gimpmd_schemas.errors import BackendError


def test_columns():
    frame = dataframe({"a": np.arange(3), "b": np.ones(3)})
    assert frame["a"].sum() == 3


def test_without_pandas(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(BackendError, match="pip install pandas"):
        dataframe({})
