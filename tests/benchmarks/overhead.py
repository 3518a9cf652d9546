"""What the coupling costs: a coupled run against a bare LAMMPS script, in turn.

Both have the same atoms, ranks and MD steps, and are timed block by block in one run
(``beside.py``), as a machine may change its speed from second to second. A block is four coupling
steps, after which the three levels stand at the same time. The gate is on the median over the
blocks of coupled time to bare time.

On a machine of uneven speed that ratio is uncertain. So there is a second one, of the coupled time
to the part of it that LAMMPS takes. It does not depend on the machine's speed from block to block,
but does not show by how much the coupling makes LAMMPS itself slower.

    python -m tests.benchmarks.overhead [--runs 3] [--sizes small large full metal metal-large]
                                        [--apart] [--whole]

On two cores, two MD ranks and the continuum share them. With ``--apart`` each has a core of its
own, as on most clusters: one MD rank, and one thread of the continuum.

With ``--whole`` the bare LAMMPS has atoms in the whole body. So the ratio is that of pure MD to the
coupled run on the same cores; it should be at least .85 of the ratio of the numbers of atoms.

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
LEAST_TIME_RATIO = 0.85
"""Least gain in time over pure MD, relative to the gain in atoms."""


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


def time_blocks(size: str, folder: Path, apart: bool = False, whole: bool = False) -> np.ndarray:
    """Wall seconds of blocks: coupled, bare, coupled within LAMMPS; and both numbers of atoms.

    The shape is ``(blocks, 5)``.
    """
    path, run = write_case(size, folder, apart), folder / "run"
    services = make_ready(read_case(path), path, run, force=False).services

    def started(endpoint: str) -> list[Service]:
        sides = services.sides(endpoint)
        return [beside(one, whole) if one.name == "md" else one for one in sides]

    supervise(services.coupler, started, Quiet())
    return np.loadtxt(run / "blocks.csv", delimiter=",")[WARM_UP:]


def beside(service: Service, whole: bool) -> Service:
    """The MD service with a bare LAMMPS beside it."""
    words = [*service.argv, *(["--whole"] if whole else [])]
    at = words.index("-m")
    words[at : at + 2] = [str(Path(__file__).with_name("beside.py"))]
    return dataclasses.replace(service, argv=words)


def main() -> int:
    """Print milliseconds per coupling step and ratios; 1 if a median is above its limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--apart", action="store_true", help="one MD rank: a core for each process")
    parser.add_argument("--whole", action="store_true", help="pure MD of the whole body beside it")
    parser.add_argument("--sizes", nargs="+", choices=LIMITS, default=list(SCALES))
    options = parser.parse_args()
    failed = 0
    for size in options.sizes:
        runs = []
        for run in range(options.runs):
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary) / "case"
                runs.append(time_blocks(size, folder, options.apart, options.whole))
            show = show_whole if options.whole else show_overhead
            print(f"{size:6s} run {run + 1}: {show(runs[-1])}", flush=True)
        every = np.concatenate(runs)
        if options.whole:
            median, limit = float(np.median(time_ratio(every))), LEAST_TIME_RATIO
            failed |= median < limit
        else:
            median, limit = float(np.median(every[:, 0] / every[:, 1])), LIMITS[size]
            failed |= median > limit
        print(f"{size:6s} median ratio {median:.3f} (limit {limit:.2f})", flush=True)
    return int(failed)


def show_overhead(blocks: np.ndarray) -> str:
    """Times of a coupling step, and what the coupling adds to them."""
    coupled, bare = np.median(blocks[:, :2], axis=0) * 1e3 / BLOCK
    low, median, high = np.percentile(blocks[:, 0] / blocks[:, 1], [25, 50, 75])
    within = np.percentile(blocks[:, 0] / blocks[:, 2], [25, 50, 75])
    return (
        f"coupled {coupled:6.1f} ms, bare LAMMPS {bare:6.1f} ms "
        f"per coupling step; ratio {median:.3f} (quartiles {low:.3f} and {high:.3f}); "
        f"to the time within LAMMPS {within[1]:.4f} ({within[0]:.4f} and {within[2]:.4f})"
    )


def show_whole(blocks: np.ndarray) -> str:
    """Times of a coupling step, coupled and in pure MD, and both numbers of atoms."""
    coupled, pure = np.median(blocks[:, :2], axis=0) * 1e3 / BLOCK
    part, whole = blocks[0, 3:].astype(int)
    low, median, high = np.percentile(time_ratio(blocks), [25, 50, 75])
    return (
        f"coupled {coupled:6.1f} ms with {part} atoms, pure MD {pure:6.1f} ms with {whole}; "
        f"ratio of times over ratio of atoms {median:.3f} (quartiles {low:.3f} and {high:.3f})"
    )


def time_ratio(blocks: np.ndarray) -> np.ndarray:
    """Time of pure MD over that of the coupled run, over the ratio of their numbers of atoms."""
    return np.asarray(blocks[:, 1] / blocks[:, 0] * blocks[:, 3] / blocks[:, 4])


if __name__ == "__main__":
    sys.exit(main())
