"""One wave for every pair of codes: a packet of 8 cells, coupled by force.

    python -m tests.physics.sides [WORD ...]

runs the wave both ways with every MD code and every continuum code, and prints a Markdown table.
Words choose among the codes. ``foreign``, the service in Rust, takes part if it has been built
(``cargo build --release`` in its folder). Ends with 1 if a pair does not keep the bounds of the
force scheme.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec

from gimpmd_schemas.case.form import Case
from tests.measuring import measured
from tests.physics.interface import packets
from tests.physics.interface.running import new_folder
from tests.physics.strips import CELL, SCRIPT, H, Run, Wave, crossing, ground, plain, run_case
from tests.services.gimp.fem.meshes import around
from tests.services.md.engines.ase import inputs

WAVE = Wave(8.0, "P")
"""The shortest wave with bounds for R and T, and so the shortest strip."""

ASE_INPUT, MESH = "block.yaml", "mesh.vtu"

ROOT = Path(__file__).parents[2]
MD = {"lammps": "services/md/gimpmd_md/engines/lammps", "ase": "services/md/gimpmd_md/engines/ase"}
CONTINUA = {
    "gimp": "services/gimp/gimpmd_gimp/gimp.py",
    "fem": "services/gimp/gimpmd_gimp/fem",
    "foreign": "examples/foreign-service/src",
}
"""The codes, and where their adapters are. Those of ``fem`` and ``foreign`` are whole codes."""

PROGRAM = ROOT / "examples" / "foreign-service" / "target" / "release" / "foreign-service"
"""The service in Rust."""


def run_sides(way: packets.Way, folder: Path, md: str, continuum: str, growth: float = 0.0) -> Run:
    """Run the strip with two codes by the command.

    With ``growth``, the continuum has a mesh from a file. Its vertices lie off the node lines by up
    to a fifth of an element, and its elements become longer by this factor from one to the next.
    """
    case = packets.strip("force", WAVE, way)
    if md != "lammps":
        case = _measured(case, folder)
    if md == "ase":
        crystal = inputs.CRYSTAL | {"sites": [[0.0, 0.0], [0.5, 0.5]]}
        inputs.write(folder, calculator=inputs.FAST, crystal=crystal)
        case["md"] |= {"backend": md, "input": ASE_INPUT, "files": [inputs.MODULE_FILE]}
    chosen = {"command": [str(PROGRAM)]} if continuum == "foreign" else {"backend": continuum}
    case["continuum"] |= chosen
    if growth:
        folder.mkdir(parents=True, exist_ok=True)
        (start, end), height = case["domain"]["box"]
        inner = (case["md"]["region"][0][0] - H, end), height
        around(folder / MESH, ((start, end), height), inner, H, ("left",), growth, shake=0.2)
        case["continuum"]["mesh"] = MESH
    return run_case(case, folder)


def _measured(strip: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The case with all that LAMMPS measures filled in: only it finds material and planes."""
    case = msgspec.convert(strip, Case)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CELL.name).write_text(CELL.read_text())
    (folder / SCRIPT).write_text(ground().lammps(case))
    return plain(measured(case, folder))


def table(chosen: list[str]) -> tuple[list[str], bool]:
    """Lines of the table, and whether all pairs keep the bounds."""
    grid = crossing(run_case(packets.grid(WAVE), new_folder(), *packets.ALONE))
    lines = [
        f"The continuum alone (GIMP): R = {grid[0]:.4f}, T = {grid[1]:.4f}",
        "",
        "| pair | way | R | T | energy at the end / at the start | busy per step, ms "
        "| wall time per step, ms | bounds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    kept = True
    for md in [name for name in MD if name in chosen]:
        for continuum in [name for name in CONTINUA if name in chosen]:
            for way in packets.WAYS:
                run = run_sides(way, new_folder(), md, continuum)
                R, T = crossing(run)
                passed = all(
                    check.passed for check in packets.judged("force", WAVE, way, (R, T), grid)
                )
                kept &= passed
                energy, steps = run.energies.energy, len(run.energies.time) - 1
                busy = [1e3 * run.timings.busy[f"{role}/0"] / steps for role in ("md", "continuum")]
                wall = 1e3 * sum(run.timings.totals()["md"].values()) / steps
                lines.append(
                    f"| {md}, {continuum} | {way} | {R:.4f} | {T:.4f} "
                    f"| {energy[-1] / energy[0]:.4f} | {busy[0]:.1f} + {busy[1]:.1f} | {wall:.1f} "
                    f"| {'kept' if passed else 'BROKEN'} |"
                )
    lines += ["", "| code | lines of its adapter |", "|---|---|"]
    lines += [f"| {name} | {_lines(place)} |" for name, place in (MD | CONTINUA).items()]
    return lines, kept


def _lines(place: str) -> int:
    """Lines of the files in a folder, or of one file."""
    path = ROOT / place
    files = [f for f in path.iterdir() if f.suffix in (".py", ".rs")] if path.is_dir() else [path]
    return sum(len(file.read_text("utf-8").splitlines()) for file in files)


if __name__ == "__main__":
    built = [name for name in CONTINUA if name != "foreign" or PROGRAM.exists()]
    printed, all_kept = table(sys.argv[1:] or [*MD, *built])
    print("\n".join(printed))
    sys.exit(0 if all_kept else 1)
