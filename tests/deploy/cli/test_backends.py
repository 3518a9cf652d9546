"""``gimpmd backends``."""

from __future__ import annotations

import pytest

from gimpmd_schemas.registry import Abilities, InstalledCode


def test_the_codes_of_both_sides_are_listed(bench):
    result = bench.gimpmd("backends")
    assert result.exit_code == 0
    words = [line.split() for line in result.stdout.splitlines()]
    assert ["md.backend:"] in words
    assert ["continuum.backend:"] in words
    assert ["gimp", "version", "gimp", "0.1.0"] in words
    assert ["ranks", "at", "most", "1"] in words  # ASE
    assert ["ranks", "any", "number"] in words  # LAMMPS


def test_what_is_not_stated_and_what_cannot_be_used(bench, monkeypatch: pytest.MonkeyPatch):
    codes = [
        InstalledCode("md", "broken", problem="cannot import it"),
        InstalledCode("md", "silent", "silent 2"),
        InstalledCode("md", "able", "able 3", Abilities((2,), "springs", ("force",), 4, True)),
    ]
    monkeypatch.setattr("gimpmd_deploy.cli.backends.installed_codes", lambda role: codes)
    words = [line.split() for line in bench.gimpmd("backends").stdout.splitlines()]
    assert ["broken", "cannot", "be", "used", "cannot", "import", "it"] in words
    assert ["silent", "version", "silent", "2"] in words
    assert ["abilities", "not", "stated"] in words
    assert ["potentials", "springs"] in words
    assert ["laws", "springs"] in words
    assert ["ranks", "at", "most", "4"] in words
    assert ["checkpoint", "yes"] in words
