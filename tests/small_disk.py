"""A folder that is a small disk of its own for one command, without rights of root."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

_MOUNT = 'mount -t tmpfs -o size="$1" tmpfs "$2" && shift 2 && exec "$@"'


def on_a_small_disk(folder: Path, size: str, *words: str) -> list[str]:
    """Words that run a command which finds an empty disk of some bytes (``"12k"``) in a folder."""
    unshare = ["unshare", "--map-root-user", "--mount"]
    if subprocess.run([*unshare, "true"], capture_output=True, check=False).returncode:
        pytest.skip("unshare cannot make a mount namespace here")
    return [*unshare, "sh", "-c", _MOUNT, "sh", size, str(folder), *words]
