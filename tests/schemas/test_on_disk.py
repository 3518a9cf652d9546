"""Files that are on disk whole, or not at all."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from gimpmd_schemas.on_disk import write_at_once


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
