"""Whole small runs through the command line."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import psutil
import pytest
import yaml
from PIL import Image

from gimpmd_schemas.case.load import load_case
from tests.deploy.conftest import ATOMS, CASE, Bench, changed

LONG = {"time.end": 400}


def gimpmd(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gimpmd_deploy.cli.app", *map(str, words)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a coupled run and one of each side alone."""
    folder = tmp_path_factory.mktemp("results")
    Bench(folder).write()
    for words in ((), ("--only", "md"), ("--only", "continuum")):
        result = gimpmd("run", "case.yaml", *words, cwd=folder)
        assert result.returncode == 0, result.stderr
        assert "finished at step 10 of 10, t = 0.8" in result.stdout
    return folder / "runs"


def test_run_folder_is_complete(results):
    run = results / "block"
    case = load_case(run / "case.yaml")
    assert case.md.cutoff == 2.5  # what LAMMPS said
    assert (run / "input" / "atoms.in").read_text() == ATOMS
    for name in ("run.h5", "fields/points.vtkhdf", "atoms/atoms.dump", "logs/md.log"):
        assert (run / name).stat().st_size > 0
    with h5py.File(run / "run.h5") as file:
        assert file.attrs["outcome"] == "completed"
        assert file["series/step"][-1] == 10


def test_figures_can_be_seen(results):
    for run in ("block", "block-md", "block-continuum"):
        names = {path.name for path in (results / run / "figures").iterdir()}
        stresses = {"sigma_yy.png"} | {f"sigma_yy_{index:04d}.png" for index in range(3)}
        assert names == {*stresses, "energies.png", "wall_time.png"}
        with Image.open(results / run / "figures" / "sigma_yy.png") as image:
            assert len(image.convert("RGB").getcolors(1 << 24)) > 100


def test_report(results):
    result = gimpmd("report", results / "block", "--json", cwd=results)
    report = json.loads(result.stdout)
    assert report["outcome"] == "completed"
    assert (report["steps"], report["last_step"]) == (10, 10)
    assert report["points"] == 1560
    assert report["atoms"] > 4000
    assert report["mass_change"] == 0.0
    assert 0.0 < report["energy"] == pytest.approx(report["external_work"], rel=0.05)
    assert {"lammps", "wait"} <= set(report["timings"]["md"])
    assert {"step", "wait"} <= set(report["timings"]["continuum"])
    assert min(report["memory"].values()) > 2**20
    text = gimpmd("report", results / "block", cwd=results).stdout
    for word in ("completed", "1,560 material points", "energy balance", "took", "lammps"):
        assert word in text


def test_compare_with_itself_is_zero(results):
    result = gimpmd("compare", results / "block", results / "block", "--json", cwd=results)
    last = json.loads(result.stdout)["differences"][-1]
    assert last["time"] == pytest.approx(0.8)
    assert last["displacement_md"] == last["displacement_continuum"] == 0.0


def test_compare_coupled_with_pure_md(results):
    result = gimpmd("compare", results / "block", results / "block-md", "--json", cwd=results)
    last = json.loads(result.stdout)["differences"][-1]
    # the front has gone 1.9 cells into a grid that spreads it over about one
    assert 0.0 < last["displacement_continuum"] < 0.2
    text = gimpmd("compare", results / "block", results / "block-md", cwd=results).stdout
    assert "energy balance" in text


def test_plot_draws_again(results):
    (results / "block" / "figures" / "energies.png").unlink()
    assert gimpmd("plot", results / "block", cwd=results).returncode == 0
    assert (results / "block" / "figures" / "energies.png").exists()


def test_force_overwrites_the_run_and_nothing_else(results):
    mine = results / "block-continuum" / "notes.txt"
    mine.write_text("keep")
    words = ("run", "case.yaml", "--only", "continuum")
    assert gimpmd(*words, cwd=results.parent).returncode == 2
    assert gimpmd(*words, "--force", cwd=results.parent).returncode == 0
    assert mine.read_text() == "keep"


def test_validate(bench):
    path = bench.write()
    result = bench.gimpmd("validate", path, "--picture", "setup.png", "--json")
    assert result.exit_code == 0, result.output
    cost = json.loads(result.stdout)
    assert cost["points"] == 1560
    assert cost["atoms"] is None
    assert cost["steps"] == 10
    speed = ((27.83 + 2 * 27.83) / 0.9318) ** 0.5
    assert cost["cfl"] == pytest.approx(speed * 0.08 / 4)
    with Image.open("setup.png") as image:
        assert image.size[0] > 500
    assert not bench.runs.exists()


def test_validate_asks_lammps(bench):
    result = bench.gimpmd("validate", bench.write(), "--probe")
    assert result.exit_code == 0, result.output
    atoms = int(re.search(r"atoms\s+([\d,]+)", result.stdout)[1].replace(",", ""))
    assert atoms == pytest.approx(60 * 80 / 1.0731935, rel=0.02)


@pytest.fixture
def long_run(tmp_path):
    """Start a run that would take minutes; wait for its first steps."""
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(changed(CASE, LONG)))
    (tmp_path / "atoms.in").write_text(ATOMS)
    process = subprocess.Popen(
        [sys.executable, "-m", "gimpmd_deploy.cli.app", "up", "case.yaml"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    lines = []
    for line in process.stdout:
        lines.append(line)
        if line.startswith("step "):
            break
    family = psutil.Process(process.pid).children(recursive=True)
    assert len(family) >= 4, lines  # coupler, gimp, mpiexec, rank
    yield process, family, lines
    if process.poll() is None:
        process.kill()
    process.communicate()
    assert wait_for_end(family, 20.0) == [], "processes were left behind"


def wait_for_end(family: list[psutil.Process], seconds: float) -> list[psutil.Process]:
    """Who still runs after a while; the dead that nobody has reaped do not count."""
    limit = time.monotonic() + seconds
    while True:
        alive = [p for p in family if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
        if not alive or time.monotonic() > limit:
            return alive
        time.sleep(0.1)


def find(family: list[psutil.Process], module: str) -> psutil.Process:
    return [p for p in family if module in p.cmdline() and "mpiexec" not in p.cmdline()[0]][-1]


def test_interrupt_stops_cleanly(long_run, tmp_path):
    process, family, lines = long_run
    assert any("coupler | " in line for line in lines)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=40)
    assert process.returncode == 0, err
    assert re.search(r"stopped at step \d+ of 5000, t = ", out)
    with h5py.File(tmp_path / "runs" / "block" / "run.h5") as file:
        assert file.attrs["outcome"] == "stopped"
    assert wait_for_end(family, 0.5) == []


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("gimpmd_coupler.service", "coupler was lost"),
        ("gimpmd_md.service", "md/0 was lost"),
        ("gimpmd_gimp.service", "continuum/0 was lost"),
    ],
)
def test_killed_process_is_named(long_run, module, name):
    process, family, _ = long_run
    os.kill(find(family, module).pid, signal.SIGKILL)
    begin = time.monotonic()
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - begin < 6.0
    assert process.returncode == 3
    assert name in err
    assert "Traceback" not in err
    assert wait_for_end(family, 0.5) == []


def test_killed_supervisor_leaves_nothing_behind(long_run, tmp_path):
    process, family, _ = long_run
    process.kill()
    assert wait_for_end(family, 20.0) == []
    with h5py.File(tmp_path / "runs" / "block" / "run.h5") as file:
        assert file.attrs["outcome"] == "stopped"
