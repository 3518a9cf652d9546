"""What a replay begins with: its recording, its plan, its folder and its services."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from gimpmd_deploy.launch.replay import ReadyReplay, Wanted, default_folder, make_ready, survey
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import load_plan, make_plan, write_plan
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.run_lock import take_lock
from gimpmd_schemas.wire.messages import Refused, encode
from gimpmd_schemas.wire.recording import RECORDING, open_recording
from gimpmd_schemas.wire.replay import Replay, load_settings
from tests.cases import ATOMS, CASE, CONTINUUM_ONLY, changed
from tests.recordings import payload, write

RANKS = {"md.ranks": 2}
STEPS = 10


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run of ten steps; the recording has fields on nodes of its own."""
    return make_run(tmp_path / "run", RANKS)


def make_run(folder: Path, changes: dict[str, Any]) -> Path:
    case = msgspec.convert(changed(CASE, changes | {"record": True}), Case)
    (folder / "input").mkdir(parents=True)
    (folder / "input" / "atoms.in").write_text(ATOMS)
    dump_case(case, folder / "case.yaml")
    write_plan(make_plan(case), folder / "plan.yaml")
    write(folder / RECORDING, STEPS)
    return folder


def ready(run: Path, wanted: Wanted, out: str = "out") -> ReadyReplay:
    found = make_ready(run, run.parent / out, wanted, force=False)
    found.lock.close()
    return found


def test_a_replay_has_the_plan_of_the_run(run: Path) -> None:
    found = ready(run, Wanted("continuum"))
    before = load_plan(run / "plan.yaml")
    assert before.record
    assert load_plan(found.folder / "plan.yaml") == found.plan
    assert found.plan == msgspec.structs.replace(before, record=False)
    assert (found.folder / "input" / "atoms.in").read_text() == ATOMS
    assert load_settings(found.folder) == Replay(
        recording=str(run / RECORDING), side="continuum", tolerance={}, goes_on=False
    )
    assert (found.notes, found.command) == ((), ())


@pytest.mark.parametrize(("side", "ranks"), [("continuum", 1), ("md", 2)])
def test_the_player_takes_the_place_of_one_service(run: Path, side: str, ranks: int) -> None:
    services = ready(run, Wanted(side)).services
    sides = {one.name: " ".join(one.argv) for one in services.sides("unix/x")}
    player, other = (
        (sides["gimp"], sides["md"]) if side == "continuum" else (sides["md"], sides["gimp"])
    )
    assert "-m gimpmd_coupler.replay --run-dir" in player
    assert (f"-n {ranks}" in player) == (ranks > 1)
    assert ".service" in other


def test_a_command_takes_the_place_of_the_other_service(run: Path) -> None:
    services = ready(run, Wanted("md", command=("perf", "record", "solid"))).services
    gimp = services.sides("unix/x")[1]
    assert gimp.argv[:4] == ["perf", "record", "solid", "--run-dir"]


def test_the_other_side_may_be_started_by_hand(run: Path) -> None:
    found = ready(run, Wanted("md", by_hand=True))
    endpoint = found.services.coupler.argv[-1]
    assert [one.name for one in found.services.sides(endpoint)] == ["md"]
    place, settings, command = found.command
    assert place == f"cd {found.folder}"
    assert settings.startswith("export OMP_NUM_THREADS=1")
    assert f"gimpmd_gimp.service --run-dir {found.folder}" in command
    assert command.endswith(f"--connect {endpoint} --patience 600")
    run_ids = {w[w.index("--run") + 1] for w in (found.services.coupler.argv, command.split())}
    assert len(run_ids) == 1


@pytest.mark.parametrize(
    ("wanted", "last"),
    [
        pytest.param(Wanted("md"), STEPS, id="all"),
        pytest.param(Wanted("md", steps=4), 4, id="some"),
        pytest.param(Wanted("md", steps=40), STEPS, id="more than there are"),
    ],
)
def test_a_replay_ends_with_the_recording(run: Path, wanted: Wanted, last: int) -> None:
    assert ready(run, wanted).plan.steps == last


def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(run: Path) -> None:
    (run / RECORDING).write_bytes((run / RECORDING).read_bytes()[:-20])  # in that of md/1
    found = ready(run, Wanted("md"))
    assert found.plan.steps == STEPS - 1
    assert found.notes == (f"the replay ends at step {STEPS - 1} of {STEPS}",)
    assert ready(run, Wanted("continuum"), "other").plan.steps == STEPS


def test_the_replay_of_a_run_that_failed_goes_to_its_failure(run: Path) -> None:
    tail = (payload(("continuum", 0), 6), encode(Refused(reason="md/0 was lost")))
    write(run / RECORDING, 5, *tail)
    for side in ("continuum", "md"):
        found = ready(run, Wanted(side), side)
        assert found.plan.steps == 6
        assert found.notes == ("the recorded run failed: md/0 was lost",)
    assert ready(run, Wanted("md", steps=3), "early").plan.steps == 3


def test_a_tolerance_is_relative_to_the_largest_recorded_value(run: Path) -> None:
    settings = load_settings(ready(run, Wanted("continuum", tolerance=1e-3)).folder)
    most = 100.0 * STEPS + 5
    assert settings.tolerance == {"mass": 1e-3 * (most + 0.5), "velocity": 1e-3 * most}


def test_steps_end_where_all_levels_stand(run: Path) -> None:
    cells = load_plan(run / "plan.yaml").level_cells
    plan = msgspec.structs.replace(
        load_plan(run / "plan.yaml"), level_cells=(4 * cells[0], 2 * cells[0], *cells)
    )
    with open_recording(run / RECORDING) as recording:
        assert survey(recording, plan, Wanted("md")).last == 8


def refused(run: Path, match: str) -> None:
    with pytest.raises(InputError, match=match):
        make_ready(run, run.parent / "out", Wanted("md"), force=False)
    assert not (run.parent / "out").exists()


def test_what_cannot_be_replayed_is_refused(run: Path, tmp_path: Path) -> None:
    refused(tmp_path, "there is no run in this folder")
    refused(make_run(tmp_path / "one", CONTINUUM_ONLY), "one side has nothing to replay")
    with take_lock(run):
        refused(run, "a run is going on|in use")
    whole = (run / RECORDING).read_bytes()
    (run / RECORDING).write_bytes(whole[:100])
    refused(run, "the run ended before its first step")
    (run / RECORDING).write_bytes(whole[:-8] + b"damaged!")
    refused(run, r"damaged at byte.*step 10")
    (run / RECORDING).unlink()
    refused(run, "was not recorded.*\n.*record: true")


def test_the_folder_of_a_replay_is_named_after_the_run() -> None:
    assert default_folder(Path("runs/wave"), "md") == Path("runs/wave-replay-md")
