"""Processor time that the look at the lowest mode takes before a run of the sites scheme.

``python -m tests.benchmarks.lowest_mode`` prints the table of docs/scheme-fs.md;
``python -m tests.benchmarks.lowest_mode copper-wave`` a row of it. Both services run in processes
of their own, on one core; the time to measure the planes is not part of it.
"""

from __future__ import annotations

import resource
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from gimpmd_deploy.launch.modes import look_at_modes
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from tests.copper_sites import SILICON, copper_case, write_scripts
from tests.measuring import measured
from tests.physics.embedded import STYLE, density_at_rest, write_potential
from tests.sites_case import CELL, SCRIPT, A, sites_case

EXAMPLES = Path(__file__).parents[2] / "examples"


def plate(folder: Path, cells: int, script: str = SCRIPT, scale: float = 1.0) -> Case:
    """A square of the hexagonal crystal in a plate, so many cells wide with its ghosts."""
    (folder / "plate.in").write_text(script)
    h = CELL * scale
    return sites_case(
        **{
            "grid.cell": h,
            "domain.box": [[0.0, (cells + 10) * h]] * 2,
            "md.region": [[5.2 * h, (cells + 5.4) * h], [5.3 * h, (cells + 4.7) * h]],
        }
    )


def embedded(folder: Path, cells: int) -> Case:
    """The same with embedded atoms."""
    write_potential(folder)
    spacing = (2.0 / (density_at_rest(folder) * 3.0**0.5)) ** 0.5
    lines = [line for line in SCRIPT.splitlines() if not line.startswith("pair_")]
    script = "\n".join(lines).replace(repr(A), repr(spacing)) + f"\n{STYLE}"
    case = plate(folder, cells, script, spacing / A)
    md = msgspec.structs.replace(case.atoms, files=("embedded.eam",))
    return msgspec.structs.replace(case, md=md)


def silicon(folder: Path, cells: int) -> Case:
    """A cube of silicon in a body."""
    write_scripts(folder, SILICON)
    region = ((4.3, cells + 4.2),) * 3
    return msgspec.convert(copper_case((cells + 8,) * 3, region, 0.1, SILICON), Case)


def example(folder: Path, name: str) -> Case:
    """An example of gimpmd."""
    shutil.copytree(EXAMPLES / name, folder, dirs_exist_ok=True)
    return load_case(folder / "case.yaml")


CASES: dict[str, Callable[[Path], Case]] = {
    "hexagonal LJ, 10 cells": lambda folder: plate(folder, 10),
    "hexagonal LJ, 60 cells": lambda folder: plate(folder, 60),
    "embedded atoms, 60 cells": lambda folder: embedded(folder, 60),
    "silicon, 7 cells": lambda folder: silicon(folder, 7),
    "copper-wave": lambda folder: example(folder, "copper-wave"),
    "nanoindentation": lambda folder: example(folder, "nanoindentation"),
}


def seconds() -> float:
    """Processor time of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(names: list[str]) -> None:
    """Print a row for each case."""
    print("| case | atoms and nodes: freedoms | lowest mode | seconds |\n|---|---|---|---|")
    for name in names or CASES:
        with TemporaryDirectory() as folder:
            case = measured(CASES[name](Path(folder)), Path(folder))
            start = seconds()
            found = look_at_modes(case, Path(folder) / "case.yaml")
            took = seconds() - start
        if found is None:
            raise ValueError(f"{name}: nobody knows the planes")
        mode = "not looked at" if found.lowest is None else f"{found.lowest:.1e}"
        print(f"| {name} | {found.freedoms:,} | {mode} | {took:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
