"""Run folders of the checks, and the start of the service in them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from gimpmd_coupler.check.bench import RUN, Bench
from gimpmd_deploy.check.cases import STRIP, Checkup, prepare
from gimpmd_schemas.case.plan import load_plan

ECHO = "import json, os, sys; print(json.dumps([os.getcwd(), *sys.argv[1:]]))"


def test_a_service_starts_in_a_run_folder_with_its_plan(tmp_path: Path) -> None:
    prepare(STRIP, Checkup("continuum", "fem"), False, tmp_path / "strip")
    bench = Bench(
        role="continuum",
        words=[sys.executable, "-c", ECHO],
        strip=tmp_path / "strip",
        block=None,
        out=tmp_path / "runs",
        deadline=20.0,
    )
    plan = bench.plan(steps=7)
    assert (plan.steps, plan.energies_every, plan.checkpoint) == (7, 1, None)
    assert bench.free_plan() is None
    with bench.started("echo", plan) as partner:
        assert partner.process.wait(20.0)
        run_dir = tmp_path / "runs" / "echo"
        where, *words = json.loads(partner.process.said())
    assert where == str(run_dir)
    assert words[:-1] == ["--run-dir", str(run_dir), "--run", RUN, "--connect"]
    assert words[-1].startswith("unixsock-stream/")
    assert load_plan(run_dir / "plan.yaml") == plan
    assert {path.name for path in run_dir.iterdir()} == {
        "plan.yaml", "input", "fields", "atoms", "figures", "logs",
    }  # fmt: skip
