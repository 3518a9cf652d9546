"""Files that are on disk whole, or not at all; folders in a run folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_schemas.on_disk import folder_of_logs, write_at_once


def test_a_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    for data in (b"first", b"second"):
        write_at_once(path, data)
        assert path.read_bytes() == data
    assert [one.name for one in tmp_path.iterdir()] == ["plan.yaml"]


FULL = """
import resource, sys
from pathlib import Path
from gimpmd_schemas.on_disk import write_at_once
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))  # no file may be larger
write_at_once(Path(sys.argv[1]), bytes(100))
"""


def test_a_full_disk_leaves_the_file_before(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(b"first")
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=False
    )
    assert "OSError: [Errno 27] File too large" in done.stderr
    assert path.read_bytes() == b"first"


def test_a_run_folder_that_is_missing_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--run-dir = .*there is no such folder"):
        folder_of_logs(tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert folder_of_logs(tmp_path) == folder_of_logs(tmp_path) == tmp_path / "logs"
    assert (tmp_path / "logs").is_dir()
