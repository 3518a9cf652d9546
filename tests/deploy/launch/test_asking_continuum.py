"""The question whether the mesh of a case can be used."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from gimpmd_deploy.launch.asking_continuum import check_mesh
from gimpmd_deploy.launch.reading import read_case
from gimpmd_schemas.errors import BackendError, PeerLostError
from tests.cases import CONTINUUM_ONLY

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
