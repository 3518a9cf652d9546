"""What the coupling costs: a coupled run against a bare LAMMPS script, in turn.

Both have the same atoms, ranks and MD steps, and are timed block by block in one run
(``beside.py``), as a machine may change its speed from second to second. A block is four coupling
steps, after which the three levels stand at the same time. The gate is on the median over the
blocks of coupled time to bare time.

On a machine of uneven speed that ratio is uncertain. So there is a second one, of the coupled time
to the part of it that LAMMPS takes. It does not depend on the machine's speed from block to block,
but does not show by how much the coupling makes LAMMPS itself slower.

    python -m tests.benchmarks.overhead [--runs 3] [--sizes small large full metal metal-large]
                                        [--apart]

On two cores, two MD ranks and the continuum share them. With ``--apart`` each has a core of its
own, as on most clusters: one MD rank, and one thread of the continuum.

The size "full" is `examples/mode1` as it is, 497,000 atoms. The metals are boxes of copper by
embedded atoms with four cells of continuum around them, in the sites scheme, without levels.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml

from gimpmd_deploy.launch.processes import Service
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import make_ready
from gimpmd_deploy.launch.supervise import supervise
from tests.benchmarks.beside import BLOCK
from tests.copper_sites import copper_case, write_scripts

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
WARM_UP = 2
"""Blocks that are not counted: kernels are compiled and memory is first touched."""
COARSEST = 16.0
"""Cell of the coarsest level; two finer ones lie around the atoms."""
SCALES = {"small": 1.0, "large": 2.0}
"""Scale of the geometry of ``mode1-small``: about 31,000 and 125,000 atoms."""
FULL = "full"
BOXES = {"metal": 9.4, "metal-large": 14.4}
"""Edge of the box of copper in cells of two lattice constants: about 30,000 and 100,000 atoms."""
AROUND = 4
"""Cells of continuum on each side of that box."""
BLOCKS = {"small": 40, "large": 20, FULL: 10, "metal": 20, "metal-large": 10}
LIMITS = {"small": 1.10, "large": 1.05, FULL: 1.03, "metal": 1.10, "metal-large": 1.05}
"""What the ratio may be."""


def write_case(size: str, folder: Path, apart: bool = False) -> Path:
    """Write the case of a size and its scripts; returns the path of the case."""
    if size in BOXES:
        write_scripts(folder)
    else:
        shutil.copytree(EXAMPLES / example_of(size), folder)
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(case_of(size, apart)))
    return path


def example_of(size: str) -> str:
    """The example from which a case in two dimensions is made."""
    return "mode1" if size == FULL else "mode1-small"


def case_of(size: str, apart: bool = False) -> dict:
    """Return the case of a size, to the end of its blocks, without output but at the ends."""
    if size in BOXES:
        case = box_of_copper(BOXES[size])
    else:
        case = yaml.safe_load((EXAMPLES / example_of(size) / "case.yaml").read_text())
        if size != FULL:
            case = scaled(case, SCALES[size])
    if apart:
        case["md"] |= {"ranks": 1, "patches": [1] * len(case["md"]["patches"])}
        case["continuum"]["threads"] = 1
    time = case["time"]
    time["end"] = BLOCK * (WARM_UP + BLOCKS[size]) * time["md_steps"] * time["md_timestep"]
    case["output"] = {"interval": time["end"], "energy_interval": time["end"]}
    return case


def box_of_copper(edge: float) -> dict:
    """A cube of atoms with an edge of so many cells, in a body, on two ranks of the MD."""
    cells = math.ceil(edge) + 2 * AROUND
    low = 0.5 * (cells - edge)
    case = copper_case((cells,) * 3, ((low, low + edge),) * 3, 1.0)
    case["md"] |= {"ranks": 2, "patches": [2, 1, 1]}
    del case["continuum"]["threads"]
    return case


def scaled(case: dict, scale: float) -> dict:
    """Return ``mode1-small`` with all lengths scaled.

    The continuum has the paper's three levels (cells of 16, 8 and 4, the finest around the
    atoms), for which the domain is rounded to whole cells of 16.
    """
    box = [[0.0, COARSEST * round(scale * high / COARSEST)] for _, high in case["domain"]["box"]]
    case["domain"]["box"] = box
    middle = 0.5 * sum(box[1])
    half = 0.5 * scale * (case["md"]["region"][1][1] - case["md"]["region"][1][0])
    region = [[0.0, scale * case["md"]["region"][0][1]], [middle - half, middle + half]]
    case["md"]["region"] = region
    fine = around(region, 16.0, 8.0)  # four cells
    case["grid"] = {
        "cell": COARSEST,
        "levels": [{"boxes": [around(fine, 32.0, 16.0)]}, {"boxes": [fine]}],
    }
    variables = case["md"]["variables"]
    for name in variables:
        variables[name] = middle if name == "crack_plane" else scale * variables[name]
    case["continuum"].pop("cracks", None)
    return case


def around(box: list[list[float]], margin: float, cell: float) -> list[list[float]]:
    """Box with a margin, ends on lines of a grid; its lower x stays on the domain's face."""
    (_, x1), (y0, y1) = box
    return [
        [0.0, cell * math.ceil((x1 + margin) / cell)],
        [cell * math.floor((y0 - margin) / cell), cell * math.ceil((y1 + margin) / cell)],
    ]


class Quiet:
    """Whoever watches the run, and says nothing."""

    def event(self, event: object) -> None:
        """Take no note."""

    def say(self, text: str) -> None:
        """Show nothing."""

    def tick(self) -> None:
        """Draw nothing."""


def time_blocks(size: str, folder: Path, apart: bool = False) -> np.ndarray:
    """Wall seconds of blocks: coupled, bare, coupled within LAMMPS; shape ``(blocks, 3)``."""
    path, run = write_case(size, folder, apart), folder / "run"
    services = make_ready(read_case(path), path, run, force=False).services

    def started(endpoint: str) -> list[Service]:
        return [beside(one) if one.name == "md" else one for one in services.sides(endpoint)]

    supervise(services.coupler, started, Quiet())
    return np.loadtxt(run / "blocks.csv", delimiter=",")[WARM_UP:]


def beside(service: Service) -> Service:
    """The MD service with a bare LAMMPS beside it."""
    words = list(service.argv)
    at = words.index("-m")
    words[at : at + 2] = [str(Path(__file__).with_name("beside.py"))]
    return dataclasses.replace(service, argv=words)


def main() -> int:
    """Print milliseconds per coupling step and ratios; 1 if a median is above its limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--apart", action="store_true", help="one MD rank: a core for each process")
    parser.add_argument("--sizes", nargs="+", choices=LIMITS, default=list(SCALES))
    options = parser.parse_args()
    failed = 0
    for size in options.sizes:
        limit = LIMITS[size]
        every = []
        for run in range(options.runs):
            with tempfile.TemporaryDirectory() as temporary:
                times = 1e3 / BLOCK * time_blocks(size, Path(temporary) / "case", options.apart)
            every.append(times[:, 0] / times[:, 1])
            coupled, bare, _ = np.median(times, axis=0)
            within = np.percentile(times[:, 0] / times[:, 2], [25, 50, 75])
            low, median, high = np.percentile(every[-1], [25, 50, 75])
            print(
                f"{size:6s} run {run + 1}: coupled {coupled:6.1f} ms, bare LAMMPS {bare:6.1f} ms "
                f"per coupling step; ratio {median:.3f} (quartiles {low:.3f} and {high:.3f}); "
                f"to the time within LAMMPS {within[1]:.4f} ({within[0]:.4f}, {within[2]:.4f})",
                flush=True,
            )
        median = float(np.median(every))
        failed |= median > limit
        print(f"{size:6s} median ratio {median:.3f} (limit {limit:.2f})", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
