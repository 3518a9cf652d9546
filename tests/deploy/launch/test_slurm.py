"""Batch scripts for Slurm; ``tests/cluster`` runs them."""

import subprocess
from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch.slurm import script, submit
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.cases import CASE, changed


def script_of(folder: Path, options=(), **changes) -> str:
    plan = make_plan(msgspec.convert(changed(CASE, changes), Case))
    return script(plan, folder, "block-1", "1:00:00", 60, options, Path("/opt/gimpmd/bin"))


def test_the_script_asks_for_a_task_for_each_rank(tmp_path):
    text = script_of(tmp_path, **{"md.ranks": 6, "continuum.ranks": 3})
    assert ' --host "$host" --ranks-md 6 --ranks-gimp 3\n' in text
    assert "#SBATCH --ntasks=10\n" in text
    assert "srun --ntasks=6 " in text
    assert "srun --ntasks=3 " in text
    assert "#SBATCH --signal=B:USR1@60\n" in text


def test_options_come_before_the_first_command(tmp_path):
    text = script_of(tmp_path, ["nodes=4", "partition=batch"])
    assert text.index("#SBATCH --nodes=4\n#SBATCH --partition=batch\n") < text.index("set -eu")


def test_a_shell_understands_it_whatever_the_folder_is_called(tmp_path):
    path = tmp_path / "job.sh"
    path.write_text(script_of(tmp_path / "it's a run"))
    subprocess.run(["bash", "-n", str(path)], check=True)
    assert '--connect "tls/$host:$port"' in path.read_text()


def test_without_slurm(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackendError, match=r"no sbatch on this host; .*job\.sh is written"):
        submit(tmp_path / "job.sh")


def test_a_refused_job(tmp_path, monkeypatch):
    sbatch = tmp_path / "sbatch"
    sbatch.write_text("#!/bin/sh\necho 'invalid partition' >&2\nexit 1\n")
    sbatch.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    with pytest.raises(BackendError, match=r"sbatch refuses .*: invalid partition"):
        submit(tmp_path / "job.sh")
