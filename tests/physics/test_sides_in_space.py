"""Pairs of codes with a wave in space: which of them say that they cannot run it, and why."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.physics.sides_in_space import MUST_RUN, cross, reason_of


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            "error: a.yaml: 2 problems\n  - b = 1: is wrong\n      do c\n  - d: too\n",
            "b = 1: is wrong",
        ),
        ("error: a.yaml: LAMMPS says no\n", "a.yaml: LAMMPS says no"),
        ("error: gimp was lost\nend of a.log:\n    x: it has two\nresults in b\n", "x: it has two"),
        ("Killed\n", "Killed"),
        ("", "no reason was given"),
    ],
)
def test_reasons_are_one_line(said: str, reason: str) -> None:
    assert reason_of(said) == reason


@pytest.mark.parametrize(
    ("md", "continuum", "reason"),
    [
        ("ase", "gimp", "md.backend = 'ase': does not know the sites scheme"),
        ("lammps", "fem", "continuum.backend = 'fem': does not know the sites scheme"),
    ],
)
def test_codes_without_the_scheme_say_so(
    tmp_path: Path, md: str, continuum: str, reason: str
) -> None:
    found = cross(tmp_path, md, continuum)
    assert (found.run, found.refused, found.reason) == (None, True, reason)
    assert (md, continuum) not in MUST_RUN
