"""The version of the layout of a record."""

from __future__ import annotations

from pathlib import Path

import h5py
import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_schemas.record_format import FORMAT_VERSION, check_format


@pytest.mark.parametrize("found", [FORMAT_VERSION - 1, FORMAT_VERSION + 1])
def test_another_format_is_refused(tmp_path: Path, found: int) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = FORMAT_VERSION
        check_format(path, file)
        file.attrs["format"] = found
        with pytest.raises(InputError, match=rf"run\.h5(.|\n)*format = {found}: "):
            check_format(path, file)
