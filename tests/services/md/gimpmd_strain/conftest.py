"""A strip of atoms dumped by LAMMPS, and the command ``gimpmd-md strain``."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from gimpmd_md.service import main
from tests.mpi import MPIEXEC
from tests.services.md.gimpmd_strain.dumps import BLOCK, STRIP, lammps_runs

Strip = Callable[..., Path]
Strain = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def strip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Strip:
    """Let LAMMPS run a warm strip of atoms, or a block, and dump it in the working directory."""
    monkeypatch.chdir(tmp_path)

    def _strip(
        name: str = "atoms.dump",
        columns: str = "id type x y z ix iy iz mass",
        boundary: str = "s s p",
        more: str = "",
        solid: bool = False,
    ) -> Path:
        script = BLOCK if solid else STRIP
        lammps_runs(script.format(name=name, columns=columns, boundary=boundary, more=more))
        return tmp_path / name

    return _strip


@pytest.fixture
def strain(tmp_path: Path) -> Strain:
    """Run ``gimpmd-md strain DUMP --out out.dump`` with options; many ranks as processes."""

    def _strain(dump: Path, *options: str, ranks: int = 1, out: str = "out.dump"):
        words = ["strain", str(dump), "--out", str(tmp_path / out), *options]
        if ranks == 1:
            stdout, stderr = io.StringIO(), io.StringIO()
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", ["gimpmd-md", *words])
                with redirect_stdout(stdout), redirect_stderr(stderr):
                    code = main()
            return subprocess.CompletedProcess(words, code, stdout.getvalue(), stderr.getvalue())
        command = [MPIEXEC, "-n", str(ranks), sys.executable, "-m", "gimpmd_md.service", *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)

    return _strain
