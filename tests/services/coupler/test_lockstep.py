"""Whole runs of the real coupler: order, content, record, stop."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import pytest

from gimpmd_schemas.errors import STOPPED
from gimpmd_schemas.record_format import FORMAT_VERSION
from gimpmd_schemas.wire.plausibility import GAIN

pytestmark = pytest.mark.timeout(60)
Start = Callable[..., Any]


def test_two_md_ranks_and_a_continuum_go_in_lockstep(start: Start) -> None:
    run = start(time__end=24)
    steps = run.plan.steps
    assert steps == 300
    children = run.join_all()
    assert run.coupler.end() == 0
    for child in children.values():
        assert child.end() == 0, child.lines
        assert child.wait_for(ended=...)["ended"] == steps
    ended = run.coupler.wait_for(type="Ended")
    assert (ended["step"], ended["stopped"]) == (steps, False)
    assert run.coupler.find(type="Progress")[-1]["step"] == steps
    assert {line["who"] for line in run.coupler.find(type="Registered")} == {
        "md/0",
        "md/1",
        "continuum/0",
    }

    with h5py.File(run.folder / "run.h5") as file:
        assert file.attrs["outcome"] == "completed"
        assert file.attrs["units"] == "lj"
        assert file.attrs["format"] == FORMAT_VERSION
        assert file.attrs["case"] == (run.folder / "case.yaml").read_text()
        k = np.arange(steps + 1)
        np.testing.assert_array_equal(file["series/step"], k)
        np.testing.assert_allclose(file["series/time"], k * run.plan.step)
        np.testing.assert_allclose(file["series/md/potential"], 2 * 0.5 * k)  # two ranks
        np.testing.assert_allclose(file["series/continuum/kinetic"], 1.0)
        np.testing.assert_allclose(file["series/total/energy"], 3 * (1.0 + 0.5 * k))
        np.testing.assert_allclose(file["series/total/external_work"], 3 * 0.75 * k)
        missing = 3 * (0.75 - 0.5) * k
        np.testing.assert_allclose(
            file["series/total/balance"], missing / np.maximum(3.0, 3 * 0.75 * k)
        )
        np.testing.assert_allclose(file["timings/md/work"], 0.5)
        assert file["timings/md/wait"].shape == (steps + 1, 2)
        assert np.all(file["timings/md/wait"][1:] > 0.0)
        assert np.all(file["memory/continuum"][:] > 1e6)
        units: dict[str, str] = {}

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                units[name] = item.attrs["units"]
                assert len(item) == steps + 1, name

        file.visititems(visit)
        assert units["series/md/momentum_x"] == "m sigma/tau"
        assert units["timings/md/wait"] == "s"
        assert units["memory/md"] == "byte"


def test_three_dimensions_keep_all_components(start: Start) -> None:
    run = start(
        domain__box=[[0, 120], [0, 80], [0, 80]],
        md__region=[[0, 80], [20, 60], [20, 60]],
        md__ranks=1,
    )
    children = run.join_all()
    assert run.coupler.end() == 0
    assert {child.end() for child in children.values()} == {0}
    with h5py.File(run.folder / "run.h5") as file:
        for role in ("md", "continuum"):
            series = file[f"series/{role}"]
            step = file["series/step"][:]
            for axis, name in enumerate(("momentum_x", "momentum_y", "momentum_z")):
                np.testing.assert_array_equal(series[name], step + 0.5 * axis)
                assert series[name].attrs["units"] == "m sigma/tau"


@pytest.mark.parametrize("only", ["md", "continuum"])
def test_one_side_alone(start: Start, only: str) -> None:
    run = start(only=only)
    children = run.join_all()
    assert run.coupler.end() == 0
    assert {child.end() for child in children.values()} == {0}
    with h5py.File(run.folder / "run.h5") as file:
        assert set(file["series"]) == {"step", "time", only, "total"}
        assert len(file["series/step"]) == run.plan.steps + 1


@pytest.mark.parametrize("how", ["line", "end of input", "signal"])
def test_stop_ends_both_sides_at_the_same_step(start: Start, how: str) -> None:
    run = start(time__end=8000)
    children = run.join_all("--pause", "0.005")
    run.coupler.wait_for(type="Progress")
    while run.coupler.lines[-1].get("step", 0) < 5:
        run.coupler.process.poll()
    stdin = run.coupler.process.stdin
    if how == "line":
        stdin.write("stop\n")
        stdin.flush()
    elif how == "end of input":
        stdin.close()
    else:
        run.coupler.kill(signal.SIGINT)
    assert run.coupler.end() == STOPPED
    assert {child.end() for child in children.values()} == {0}
    last = run.coupler.wait_for(type="Ended")
    assert last["stopped"]
    assert {c.wait_for(ended=...)["ended"] for c in children.values()} == {last["step"]}
    assert run.coupler.find(type="Progress")[-1]["step"] == last["step"]
    assert last["defect"] == ""
    with h5py.File(run.folder / "run.h5") as file:
        assert file.attrs["outcome"] == "stopped"
        assert file["series/step"][-1] == last["step"]
    stdin.close()


@pytest.mark.parametrize("on_defect", ["warn", "stop"])
def test_a_finding_is_said_once_recorded_and_ends_the_run_if_asked(
    start: Start, on_defect: str
) -> None:
    """A bond of rank 1 breaks at step 20, so the run stops at step 21."""
    run = start(time__end=8, coupling__on_defect=on_defect)
    children = run.join_all(md1=("--break-at", "20"))
    assert run.coupler.end() == (4 if on_defect == "stop" else 0)
    assert {child.end() for child in children.values()} == {0}
    (said,) = run.coupler.find(type="Found")
    assert said["step"] == 20
    assert "atoms, t = 1.6, near (10, 21): a defect of the crystal" in said["message"]
    assert "near (10, 21)" in (run.folder / "logs/coupler.log").read_text()
    ended, last = run.coupler.wait_for(type="Ended"), 21 if on_defect == "stop" else 100
    assert (ended["step"], ended["stopped"]) == (last, on_defect == "stop")
    assert ended["defect"] == (said["message"] if on_defect == "stop" else "")
    with h5py.File(run.folder / "run.h5") as file:
        stopped = "stopped: a monitor found that the results are not reliable"
        outcome = stopped if last == 21 else "completed"
        assert file.attrs["outcome"] == outcome
        (finding,) = file["findings"][:]
        assert (finding["step"], finding["value"], finding["limit"]) == (20, 1.5, 1.25)
        assert (finding["side"], finding["kind"]) == (b"md", b"broken bond")
        np.testing.assert_array_equal(finding["place"], [10.0, 21.0, np.nan])
        assert finding["message"].decode() == said["message"]


@pytest.mark.parametrize("on_defect", ["warn", "stop"])
def test_energy_that_the_body_gains_is_found_by_the_coupler(start: Start, on_defect: str) -> None:
    """Rank 1 of the atoms gains 40 at step 5; the monitor looks at step 20, the run ends at 21.

    All ranks together lose 15 until then, so 25 have no source, beside 3 at the start and 45 of
    work.
    """
    run = start(time__end=8, coupling__on_defect=on_defect)
    children = run.join_all(md1=("--gain-at", "5"))
    assert run.coupler.end() == (4 if on_defect == "stop" else 0)
    assert {child.end() for child in children.values()} == {0}
    (said,) = run.coupler.find(type="Found")
    assert said["step"] == 20
    assert "whole body, t = 1.6: the atoms and the continuum together have" in said["message"]
    last = run.coupler.wait_for(type="Ended")["step"]
    assert last == (21 if on_defect == "stop" else 100)
    with h5py.File(run.folder / "run.h5") as file:
        (finding,) = file["findings"][:]
        assert (finding["side"], finding["kind"]) == (b"body", b"total energy")
        assert (finding["step"], finding["limit"]) == (20, GAIN)
        assert finding["value"] == pytest.approx(25.0 / 48.0, rel=1e-6)  # strain of 1e-4


def test_a_stop_before_all_ranks_are_there_ends_the_run_at_once(start: Start) -> None:
    run = start()
    child = run.join("md")
    run.coupler.wait_for(type="Registered", who="md/0")
    asked = run.coupler.kill(signal.SIGTERM)
    assert run.coupler.end() == STOPPED
    assert run.coupler.wait_for(type="Ended")["at"] - asked < 2.0
    assert run.coupler.find(type="Ended")[0]["stopped"]
    assert child.end() == 3
    assert "stopped before all ranks had registered" in child.wait_for(error=...)["message"]
    with h5py.File(run.folder / "run.h5") as file:
        assert file.attrs["outcome"] == "stopped"
