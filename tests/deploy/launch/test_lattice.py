"""Questions about crystals: what the options become."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gimpmd_deploy.launch import lattice
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.lattice import Question
from tests.schemas.wire.test_lattice import CRYSTAL


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Questions and working directories; they are answered at once."""
    questions: list[Any] = []

    def answer(question: Question, folder: Path, *_: str) -> Any:
        questions.append((question, folder))
        return CRYSTAL

    monkeypatch.setattr(lattice, "_ask", answer)
    return questions


def coefficients(asked: list[Any], **options: Any) -> tuple[str, ...]:
    given = {"file": None, "elements": (), "coefficients": (), "mass": None} | options
    lattice.lattice_of_potential("eam", "fcc", "metal", **given)
    words: tuple[str, ...] = asked[-1][0].potential.pair_coeff
    return words


def test_a_file_beside_the_user_and_one_of_lammps(
    asked: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my Cu.eam").touch()
    own = coefficients(asked, file="my Cu.eam", elements=["Cu"])
    assert own == (f'* * "{tmp_path.resolve()}/my Cu.eam" Cu',)
    assert coefficients(asked, file="Ni_u3.eam") == ('* * "Ni_u3.eam"',)
    assert coefficients(asked, coefficients=["1 1 1.0 1.0"]) == ("1 1 1.0 1.0",)


def test_a_script_is_read_in_its_folder(asked: list[Any], tmp_path: Path) -> None:
    (tmp_path / "bulk.in").touch()
    lattice.lattice_of_script(tmp_path / "bulk.in")
    assert asked == [(Question(script="bulk.in"), tmp_path)]


def test_what_is_missing(asked: list[Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2 problems") as error:
        lattice.lattice_of_potential("eam", None, None, "Cu.eam", (), (), None)
    assert [problem.key for problem in error.value.problems] == ["--crystal", "--units"]
    with pytest.raises(InputError, match="does not exist"):
        lattice.lattice_of_script(tmp_path / "nowhere.in")
    assert asked == []
