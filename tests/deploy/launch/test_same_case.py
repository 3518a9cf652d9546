"""Cases against that of a run: what may differ, and how differences are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.same_case import check_same_case
from gimpmd_schemas.case.load import dump_case, load_case
from gimpmd_schemas.errors import InputError
from tests.cases import changed, small_case
from tests.system.conftest import Command


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """A case, and what its run has kept of it in the folder ``run``."""
    command = Command(tmp_path / "case")
    case = load_case(command.write(small_case()))
    (command.folder / "run/input").mkdir(parents=True)
    copy_input(case, command.folder, command.folder / "run/input")
    dump_case(case, command.folder / "run/case.yaml")
    return command


def check(command: Command, case: dict[str, object]) -> None:
    path = command.write(case)
    check_same_case(load_case(path), path, command.folder / "run")


def test_end_and_ranks_may_differ(command) -> None:
    check(command, changed(small_case(), {"time.end": 99.0, "md.ranks": 4, "md.patches": "auto"}))


def test_all_other_keys_are_named(command) -> None:
    changes = {"grid.points_per_axis": 3, "boundary.top.value": [0, 0.1]}
    with pytest.raises(InputError) as caught:
        check(command, changed(small_case(), changes))
    assert {problem.key for problem in caught.value.problems} == set(changes)
    assert "the run in" in str(caught.value)
    assert "start a new run with --force or --out" in str(caught.value)


def test_another_script_is_named(command) -> None:
    script = command.folder / "crack.in"
    script.write_text(script.read_text() + "# changed\n")
    with pytest.raises(InputError, match=r"md\.input = 'crack\.in'.*another content"):
        check(command, small_case())
