"""``deploy/compose.yaml`` with podman: three containers give the bits of one host."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gimpmd_deploy.results.run import Run
from tests.cases import EXAMPLE, small_case
from tests.conftest import ROOT

pytestmark = [pytest.mark.containers, pytest.mark.timeout(1800)]

CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
COMPOSE = ROOT / "deploy" / "compose.yaml"
PROGRAMS = Path(sys.executable).parent
SECONDS = 600.0
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
    import yaml

    folder, out, local = (tmp_path / name for name in ("case", "run", "local"))
    folder.mkdir()
    out.mkdir()
    for script in EXAMPLE.glob("*.in"):
        shutil.copy(script, folder)
    (folder / "case.yaml").write_text(yaml.safe_dump(small_case()))
    settings = tmp_path / "containers.conf"
    settings.write_text(SETTINGS)
    variables = {
        "CASE": str(folder),
        "RUN": str(out),
        "BASE": base,
        "BUILDAH_ISOLATION": "chroot",
        "CONTAINERS_CONF": str(settings),
    }
    compose = PROGRAMS / "podman-compose", "--parallel", "1", "-f", COMPOSE
    try:
        call(*compose, "build", **variables)
        call(*compose, "up", "--no-build", **variables)
    finally:
        call(*compose, "down", **variables)
    call(PROGRAMS / "gimpmd", "run", folder / "case.yaml", "--out", local, "--no-figures")
    one, other = Run(out), Run(local)
    assert one.outcome == "completed"
    for time in (0.0, 1.0, 2.0):
        a, b = one.atoms(time), other.atoms(time)
        np.testing.assert_array_equal(a.reference, b.reference)
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_array_equal(one.points(time).position, other.points(time).position)
    np.testing.assert_array_equal(one.energies.energy, other.energies.energy)
