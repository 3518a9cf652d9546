"""Questions to the continuum: can a mesh be used, and how large is a correction."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from gimpmd_deploy.launch.asking_continuum import ask_correction, check_mesh, lack_of_memory
from gimpmd_deploy.launch.reading import read_case
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.answers import CorrectionSize
from tests.cases import CONTINUUM_ONLY
from tests.sites_case import measured_case, sites_case

MESH = {"continuum.backend": "fem", "continuum.mesh": "m.vtu"}


def test_a_file_that_is_no_mesh(bench: Any) -> None:
    path = bench.write(CONTINUUM_ONLY | MESH)
    (path.parent / "m.vtu").write_text("no mesh")
    with pytest.raises(BackendError, match=r"case\.yaml: continuum\.mesh = 'm\.vtu': meshio"):
        check_mesh(read_case(path), path)


@pytest.mark.parametrize(
    "changes", [{}, {"continuum.mesh": "m.vtu", "continuum.command": ["true"]}]
)
def test_who_is_not_asked(
    bench: Any, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]
) -> None:
    path = bench.write(CONTINUUM_ONLY | changes)
    (path.parent / "m.vtu").write_text("no mesh")
    monkeypatch.setattr(subprocess, "run", None)
    check_mesh(read_case(path), path)


def test_a_service_that_crashes(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bench.write(CONTINUUM_ONLY | MESH)
    (path.parent / "m.vtu").write_text("no mesh")
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(PeerLostError, match="exit code 1 when asked for the mesh: it gave no"):
        check_mesh(read_case(path), path)


def test_the_size_of_a_correction(
    bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = measured_case(tmp_path)
    path = tmp_path / "case.yaml"
    size = ask_correction(case, path)
    assert size is not None
    assert size.equations == 600  # 100 nodes, two components and three strains
    monkeypatch.setattr(subprocess, "run", None)
    assert ask_correction(sites_case(), path) is None  # nobody knows the planes yet
    assert ask_correction(sites_case(**{"only": "md"}), path) is None
    other = {"continuum.command": ["true"], "coupling.sites": case.coupling.sites}
    assert ask_correction(sites_case(**other), path) is None


@pytest.mark.parametrize("command", ["false", "true"])
def test_no_size_of_a_correction(
    bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    case = measured_case(tmp_path)
    monkeypatch.setattr(sys, "executable", f"/bin/{command}")
    with pytest.raises(PeerLostError, match=r"case\.yaml: .*size of the correction"):
        ask_correction(case, tmp_path / "case.yaml")


def test_too_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = SimpleNamespace(available=10_000_000_000)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
    case = sites_case(**{"continuum.ranks": 4})
    size = CorrectionSize(equations=55_728, memory=2_500_000_000)
    assert lack_of_memory(case, None) == lack_of_memory(case, size) == []
    memory.available -= 1
    (said,) = lack_of_memory(case, size)
    assert "coupling.scheme: sites: " in said
    assert "2.5 GB in each of 4 continuum ranks, and this machine has 10 GB" in said
