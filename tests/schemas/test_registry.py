"""Codes found by their entry points, and mappings found by the modules of a package."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.registry import Abilities, collect, installed_codes, load_code


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
    words = (
        r"md.backend = 'none': no such code is installed \(installed: ase, broken, lammps, mine\)"
    )
    with pytest.raises(BackendError, match=words) as refused:
        load_code("md", "none")
    assert refused.value.exit_code == 2
    with pytest.raises(BackendError, match=r"continuum.backend = 'mine': no such code"):
        load_code("continuum", "mine")  # an MD code is no continuum code


def test_a_code_that_cannot_be_imported_is_named(installed: None) -> None:
    words = r"'broken': cannot import no_such_module:Atoms: No mod.*; install it: pip install no_s"
    with pytest.raises(BackendError, match=words):
        load_code("md", "broken")


def test_installed_codes_say_what_they_can_do(
    installed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fractions import Fraction

    monkeypatch.setattr(Fraction, "version", staticmethod(lambda: "fraction 1"), raising=False)
    codes = {code.name: code for code in installed_codes("md")}
    assert set(codes) == {"ase", "broken", "lammps", "mine"}
    assert isinstance(codes["lammps"].abilities, Abilities)
    assert codes["lammps"].version.startswith("lammps 20")
    assert (codes["mine"].abilities, codes["mine"].version) == (None, "fraction 1")
    assert "No module named 'no_such_module'" in codes["broken"].problem
    (gimp,) = [code for code in installed_codes("continuum") if code.name == "gimp"]
    assert gimp.abilities is not None
    assert gimp.abilities.dimensions == (2, 3)


def package(folder: Path, **modules: str) -> str:
    """Write a package of modules and return its name."""
    name = "p" + folder.name.replace("-", "_")
    (folder / name).mkdir()
    for module, text in {"__init__": "", **modules}.items():
        (folder / name / f"{module}.py").write_text(text)
    return name


def test_mappings_of_modules_are_merged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    modules = {"b": "ITEMS = {'one': 1}", "a": "ITEMS = {'two': 2}", "tools": "OTHER = {'x': 3}"}
    assert list(collect(package(tmp_path, **modules), "ITEMS").items()) == [("two", 2), ("one", 1)]


def test_two_entries_for_one_key_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    name = package(tmp_path, a="ITEMS = {'one': 1}", b="ITEMS = {'one': 2}")
    with pytest.raises(ValueError, match=r"'a' and 'b' both have an entry for 'one' in ITEMS"):
        collect(name, "ITEMS")
