"""Codes found by their entry points."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.registry import load_code


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with two entry points, one of which cannot be imported."""
    package = tmp_path / "mycode-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: mycode\nVersion: 1\n")
    (package / "entry_points.txt").write_text(
        "[gimpmd.md]\nmine = fractions:Fraction\nbroken = no_such_module:Atoms\n"
    )
    monkeypatch.syspath_prepend(tmp_path)


def test_a_code_is_found_by_its_name(installed: None) -> None:
    from fractions import Fraction

    assert load_code("md", "mine") is Fraction


def test_lammps_is_installed() -> None:
    from gimpmd_md.engines.lammps.atoms import LammpsAtoms

    assert load_code("md", "lammps") is LammpsAtoms


def test_an_unknown_name_is_refused_with_those_installed(installed: None) -> None:
    words = r"md.backend = 'none': no such code is installed \(installed: broken, lammps, mine\)"
    with pytest.raises(BackendError, match=words) as refused:
        load_code("md", "none")
    assert refused.value.exit_code == 2
    with pytest.raises(BackendError, match=r"continuum.backend = 'mine': no such code"):
        load_code("continuum", "mine")  # an MD code is no continuum code


def test_a_code_that_cannot_be_imported_is_named(installed: None) -> None:
    with pytest.raises(BackendError, match=r"'broken': cannot import no_such_module:Atoms: No mod"):
        load_code("md", "broken")
