"""``deploy/compose.yaml`` with podman: three containers give the bits of one host."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from gimpmd_deploy.results.run import Run
from tests.conftest import ROOT
from tests.small_run import PROGRAMS, check_same_bits, run_here, write

pytestmark = [pytest.mark.containers, pytest.mark.timeout(3600)]

CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
COMPOSE = ROOT / "deploy" / "compose.yaml"
SECONDS = 3000.0
SETTINGS = """\
[engine]
runtime = "runc"
[containers]
default_ulimits = ["nofile=1024:1024", "nproc=1000:1000"]
"""
"""Without systemd and in a container, podman's usual choices do not work."""


def call(*words: object, **environment: str) -> str:
    """Run a command, and return its output."""
    done = subprocess.run(
        [str(word) for word in words],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Image of Debian 12 with Python, made here where no registry can be reached."""
    name = os.environ.get("BASE", "localhost/gimpmd-base")
    missing = [name for name in ("podman", "debootstrap") if shutil.which(name) is None]
    assert not missing, f"needs root, and these commands: {', '.join(missing)}"
    if subprocess.run(["podman", "image", "exists", name], check=False).returncode == 0:
        return name
    root = tmp_path_factory.mktemp("base") / "root"
    packages = "python3,python3-venv,ca-certificates"
    call("debootstrap", "--variant=minbase", f"--include={packages}", "bookworm", root)
    shutil.copy(CERTIFICATES, root / CERTIFICATES.relative_to("/"))  # a proxy may have its own
    words = ["podman", "import", "--change", f"ENV PIP_CERT={CERTIFICATES}", "-", name]
    with subprocess.Popen(["tar", "-C", root, "-c", "."], stdout=subprocess.PIPE) as archive:
        subprocess.run(words, stdin=archive.stdout, check=True)
    return name


def test_three_containers_give_the_bits_of_one_host(base: str, tmp_path: Path) -> None:
    folder, out, local = (tmp_path / name for name in ("case", "run", "local"))
    folder.mkdir()
    out.mkdir()
    case = write(folder, 2.0)
    settings = tmp_path / "containers.conf"
    settings.write_text(SETTINGS)
    variables = {
        "CASE": str(folder),
        "RUN": str(out),
        "BASE": base,
        "BUILDAH_ISOLATION": "chroot",
        "CONTAINERS_CONF": str(settings),
    }
    program = PROGRAMS / "podman-compose"
    compose = program, "-f", COMPOSE
    try:
        # one after another: they share layers; but all containers must run at the same time
        call(program, "--parallel", "1", "-f", COMPOSE, "build", **variables)
        print(call(*compose, "up", "--no-build", **variables))  # shown if the test fails
    finally:
        call(*compose, "down", **variables)
    check_same_bits(Run(out), run_here(case, local))
