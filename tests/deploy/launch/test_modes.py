"""The lowest mode, asked of both services before a run."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from gimpmd_deploy.launch import modes
from gimpmd_deploy.launch.modes import Modes, look_at_modes, said_of
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.answers import FreeAtoms
from tests.sites_case import measured_case, sites_case

SOFT = {"from": "moduli", "density": 0.9317984, "lame": 0.05, "shear": 0.05}
"""Moduli of the continuum that are far too small, so that the corrections win."""


def test_a_set_up_that_is_not_stable_is_refused(tmp_path: Path) -> None:
    case = measured_case(tmp_path, **{"continuum.material": SOFT})
    where = r"case\.yaml: md\.region = \[\[.*\]\]: the set-up is not stable"
    with pytest.raises(BackendError, match=where) as raised:
        look_at_modes(case, tmp_path / "case.yaml")
    assert raised.value.exit_code == 2


def test_who_is_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, sites = tmp_path / "case.yaml", measured_case(tmp_path).coupling.sites
    monkeypatch.setattr(subprocess, "run", None)
    assert look_at_modes(sites_case(), path) is None  # nobody knows the planes yet
    assert look_at_modes(sites_case(**{"only": "md"}), path) is None
    other = {"continuum.command": ["true"], "coupling.sites": sites}
    assert look_at_modes(sites_case(**other), path) is None


def test_too_many_atoms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = measured_case(tmp_path)
    monkeypatch.setattr(modes, "ask_stiffness", lambda *_: FreeAtoms(freedoms=50_001))
    monkeypatch.setattr(modes, "ask_lowest_mode", None)
    found = look_at_modes(case, tmp_path / "case.yaml")
    assert found is not None
    assert (found.freedoms, found.most, found.lowest) == (50_001, 50_000, None)


def test_what_is_said() -> None:
    found = Modes(freedoms=10_626, most=12_000, lowest=1.757e-3, seconds=25.04)
    assert said_of(found) == (
        "all stable, the lowest has 1.8e-03 of the largest stiffness (10,626 freedoms, 25.0 s)"
    )
    found = Modes(freedoms=40_000, most=12_000, lowest=None, seconds=1.0)
    assert said_of(found) == (
        "not looked at: 40,000 freedoms of atoms and nodes, and at most 12,000 are"
    )
