"""What a run that goes on begins with: its checkpoint, its end, its ranks."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.resume import make_ready_again, unfinished
from gimpmd_deploy.launch.run import make_ready
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan, write_plan
from gimpmd_schemas.checkpoint.manifest import (
    FOLDER,
    Manifest,
    digest_of,
    folder_of,
    write_manifest,
)
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.replay import REPLAY
from tests.cases import CONTINUUM_ONLY


@pytest.fixture
def folder(bench) -> Path:
    """The folder of a run of the continuum that was killed after a checkpoint."""
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    commit(ready.folder, 2)
    return ready.folder


def commit(folder: Path, step: int) -> None:
    plan, place = load_plan(folder / "plan.yaml"), folder_of(folder, step)
    place.mkdir(parents=True)
    (place / "run.h5").write_bytes(b"record")
    manifest = Manifest(
        step=step,
        time=step * plan.step,
        state=plan.state_digest(),
        ranks={"continuum": 1},
        start_energy=None,
        files={"run.h5": digest_of(place / "run.h5")},
    )
    write_manifest(folder, manifest)


def test_states_without_a_manifest_are_removed(folder: Path) -> None:
    folder_of(folder, 4).mkdir()
    ready = make_ready_again(folder, None, None, None)
    assert ready.start.step == 2
    assert sorted(path.name for path in (folder / FOLDER).iterdir()) == ["2"]


def test_a_new_end_is_in_plan_and_case(folder: Path) -> None:
    before = load_plan(folder / "plan.yaml")
    end = before.steps * before.step
    make_ready_again(folder, 2.0 * end, None, None)
    after = load_plan(folder / "plan.yaml")
    assert after.steps == 2 * before.steps
    assert load_case(folder / "case.yaml").time.end == 2.0 * end
    assert after.state_digest() == before.state_digest()
    assert after.digest() != before.digest()


def test_other_ranks_are_in_plan_and_case(folder: Path) -> None:
    before = load_plan(folder / "plan.yaml")
    make_ready_again(folder, None, None, 2)
    after = load_plan(folder / "plan.yaml")
    assert (after.continuum.ranks, load_case(folder / "case.yaml").continuum.ranks) == (2, 2)
    assert after.state_digest() == before.state_digest()


def test_a_run_that_is_recorded_keeps_its_ranks(folder: Path) -> None:
    plan = load_plan(folder / "plan.yaml")
    write_plan(msgspec.structs.replace(plan, record=True), folder / "plan.yaml")
    with pytest.raises(InputError, match="leave out --ranks-md and --ranks-gimp"):
        make_ready_again(folder, None, None, 2)
    assert make_ready_again(folder, None, None, 1).start.step == 2


def test_a_replay_cannot_go_on(folder: Path) -> None:
    (folder / REPLAY).mkdir()
    with pytest.raises(InputError, match="a replay cannot go on"):
        make_ready_again(folder, None, None, None)


def test_an_end_before_the_checkpoint_is_refused(folder: Path) -> None:
    plan = (folder / "plan.yaml").read_bytes()
    with pytest.raises(InputError, match="give a later end with --until"):
        make_ready_again(folder, 1e-3, None, None)
    assert (folder / "plan.yaml").read_bytes() == plan


def test_a_run_killed_after_its_last_checkpoint_can_be_completed(folder: Path) -> None:
    last = load_plan(folder / "plan.yaml").steps
    commit(folder, last)
    assert make_ready_again(folder, None, None, None).start.step == last


def test_without_a_whole_checkpoint_there_is_nothing_to_go_on_from(folder: Path) -> None:
    (folder_of(folder, 2) / "run.h5").write_bytes(b"another")
    with pytest.raises(InputError, match=r"no checkpoint to go on from.*run\.h5 is damaged"):
        make_ready_again(folder, None, None, None)


def test_a_run_is_unfinished_until_its_last_checkpoint_is_at_its_end(
    folder: Path, tmp_path: Path
) -> None:
    found = unfinished(folder)
    assert found is not None
    assert found.step == 2
    commit(folder, load_plan(folder / "plan.yaml").steps)
    assert unfinished(folder) is None
    assert unfinished(tmp_path) is None
