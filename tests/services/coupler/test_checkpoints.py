"""When checkpoints are due, and when one is whole."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gimpmd_coupler.checkpoints import Checkpoints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.checkpoint.manifest import FOLDER, committed, damage, folder_of, state_file
from gimpmd_schemas.wire.messages import Saved
from tests.cases import CASE, changed

MD, CONTINUUM = ("md", 0), ("continuum", 0)


def plan(**changes: object) -> Plan:
    """The block, with checkpoints every minute or as the changes say."""
    checkpoint = {"minutes": 1.0, **changes}
    return make_plan(msgspec.convert(changed(CASE, {"checkpoint": checkpoint}), Case))


def save(run_dir: Path, step: int, member: tuple[str, int]) -> Saved:
    """What a rank reports that has saved its state."""
    folder = folder_of(run_dir, step)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / state_file(*member)
    path.write_bytes(f"{member} {step}".encode())
    return Saved(step=step, digest="0" * 64)


def test_a_checkpoint_is_due_after_its_time_unless_one_is_on_its_way(tmp_path: Path) -> None:
    some = Checkpoints(tmp_path, plan(), 100.0)
    assert not some.due(159.0)
    assert some.due(160.0)
    some.note_order(50, 160.0)
    assert not some.due(1000.0), "it has not been saved"


@pytest.mark.parametrize("changes", [{"steps": 10}, None])
def test_without_a_time_none_is_ordered(tmp_path: Path, changes: dict[str, int] | None) -> None:
    asked = plan(**changes) if changes else msgspec.structs.replace(plan(), checkpoint=None)
    assert not Checkpoints(tmp_path, asked, 0.0).due(1e9)


def test_it_is_whole_when_all_ranks_have_saved_and_earlier_steps_are_recorded(
    tmp_path: Path,
) -> None:
    some = Checkpoints(tmp_path, plan(), 0.0)
    some.note_saved(MD, [save(tmp_path, 50, MD)])
    assert some.ready(100) == []
    some.note_saved(CONTINUUM, [save(tmp_path, 50, CONTINUUM)])
    assert some.ready(48) == []
    assert some.ready(49) == [50]


def test_old_checkpoints_are_removed(tmp_path: Path) -> None:
    record = tmp_path / "run.h5"
    record.write_bytes(b"record")
    some = Checkpoints(tmp_path, plan(keep=2), 0.0)
    for step in (50, 100, 150):
        some.note_order(step, float(step))
        for member in (MD, CONTINUUM):
            some.note_saved(member, [save(tmp_path, step, member)])
        some.commit(step, 0.5, record)
    assert [one.step for one in committed(tmp_path)] == [150, 100]
    assert sorted(path.name for path in (tmp_path / FOLDER).iterdir()) == ["100", "150"]
    last = committed(tmp_path)[0]
    assert (last.start_energy, last.ranks) == (0.5, {"md": 1, "continuum": 1})
    assert last.state == plan(steps=7).state_digest(), "when they are made may change"
    assert "damaged" in damage(tmp_path, last), "the digest that the ranks gave is kept"
    assert not some.due(150.0 + 59.0)
    assert some.due(150.0 + 60.0), "the last order has been carried out"
