"""What helper commands of services answer, and how they fail."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gimpmd_deploy.launch.helper_command import run_helper
from gimpmd_schemas.errors import BackendError, GimpmdError, PeerLostError, StorageError
from tests.small_disk import on_a_small_disk


def ask(folder: Path, code: str) -> str:
    """The answer of a module with this code."""
    (folder / "answering.py").write_text(code)
    return run_helper(
        ["answering"],
        folder,
        about="case.yaml: ",
        service="the service",
        question="probe",
        seconds=60.0,
        too_slow="too slow",
    )


def test_the_answer_is_what_it_prints(tmp_path: Path) -> None:
    assert ask(tmp_path, "print(7)") == "7\n"


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        ("import sys; sys.stderr.write('no atoms'); sys.exit(2)", BackendError, "no atoms"),
        (
            "import os; os.abort()",
            PeerLostError,
            "the service ended with exit code -6 when asked for the probe: it gave no reason",
        ),
        (
            "import os; os.write(os.open('/dev/full', os.O_WRONLY), b'x')",
            StorageError,
            "OSError: [Errno 28] No space left on device; "
            "make room there, or set TMPDIR to another folder",
        ),
    ],
)
def test_how_it_failed(tmp_path: Path, code: str, kind: type[GimpmdError], words: str) -> None:
    with pytest.raises(kind) as caught:
        ask(tmp_path, code)
    assert str(caught.value) == f"case.yaml: {words}"


@pytest.mark.long
@pytest.mark.parametrize("size", ["4k", "12k", "20k", "28k"])
def test_a_case_on_a_full_disk(bench, size: str) -> None:
    """Whichever of the files lacks its end."""
    temporary = bench.folder / "temporary"
    temporary.mkdir()
    path = bench.write({"coupling.scheme": "force"})
    words = [sys.executable, "-m", "gimpmd_deploy.cli.app", "validate", str(path), "--probe"]
    done = subprocess.run(
        on_a_small_disk(temporary, size, *words),
        env=os.environ | {"TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
