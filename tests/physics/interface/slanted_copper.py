"""Waves that leave copper at a slant, coupled by the sites scheme in space.

``python -m tests.physics.interface.slanted_copper KIND:LENGTH:ACROSS:CYCLES ...`` prints rows of
the table of docs/scheme-fs.md, with ``--absorber both`` those with an absorber too. The wave vector
lies in the plane of x and y. One wave spans the width of a strip, which is periodic along y and z,
so the sine of its angle to x is LENGTH / ACROSS, both in cells.

Motions and speeds are those of the modes of the crystal. A packet has waves of many angles, and
these leave at the x components of their group velocities. Some of S waves at a large angle are
slow, or go the other way. So a run ends when little of the packet would be left in endless copper.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from mpi4py import MPI

from gimpmd_deploy.verify.crossing import energies
from gimpmd_md.crystal.cell import open_cell
from gimpmd_md.crystal.moduli import measure_all
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case import materials
from gimpmd_schemas.case.crystal_packet import PlaneWaves, modes, plane_waves
from gimpmd_schemas.case.form import Packet
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import COPPER, H, copper_case, write_scripts
from tests.physics.interface.copper_waves import DEEPER
from tests.physics.strips import Run
from tests.physics.test_sites_in_space import crossed, run_case, share

Kind = Literal["P", "S"]

THICK = 2
"""Cells along z, the fewest that gimpmd accepts: the waves do not depend on z."""

REACH = 2.94
"""Half-length of a packet, in standard deviations of its envelope, as in `wave_case`."""

BEYOND = 4.0
"""Cells beyond the end of the region of atoms that a packet shall have left behind."""

LEFT = 1e-4
"""Share of the energy that would not be there yet in endless copper when a run ends."""

FAR, PLACES = 40.0, 4001
"""Half-length of an endless body, in such deviations, and places in it."""

CUBE = 6
"""Lattice constants along the edges of the cube in which force constants are measured."""

ABSORBERS: dict[str, tuple[dict[str, Any] | None, ...]] = {
    "off": (None,),
    "on": ({},),
    "both": (None, {}),
}
"""Settings of the absorber; where it is on, packets start outside its band."""

LONG = 4.0
"""How much longer than its carrier a packet may take to leave."""


@dataclass(frozen=True)
class Slant:
    """A packet at a slant.

    Attributes
    ----------
    kind : ``P`` or ``S``.
    length : wavelength, in cells.
    across : width of the strip along y, in cells.
    cycles : of the packet.
    """

    kind: Kind
    length: float
    across: int
    cycles: float = 2.0

    @classmethod
    def of(cls, word: str) -> Slant:
        """From ``KIND:LENGTH:ACROSS:CYCLES``."""
        kind, length, across, cycles = word.split(":")
        return cls("P" if kind == "P" else "S", float(length), int(across), float(cycles))

    @property
    def degrees(self) -> float:
        """Angle of the wave vector to the normal of the planes."""
        return math.degrees(math.asin(self.length / self.across))

    @property
    def deviation(self) -> float:
        """Standard deviation of the envelope along x, in cells."""
        return self.cycles * self.length / 2.355

    def packet(self, center: float) -> Packet:
        """The packet, with its middle at x (angstrom)."""
        return Packet(
            center=center,
            wavelength=self.length * H,
            strain=2e-4,
            cycles=self.cycles,
            direction=-1,
            polarization=self.kind,
            tilt=self.degrees,
        )


@cache
def squared_speeds() -> Floats:
    """Stiffness of copper over its density (angstrom^2 / ps^2), by LAMMPS."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_scripts(folder)
        log = folder / "log.lammps"
        with open_cell(str(folder / "cell.in"), "metal", MPI.COMM_SELF, log, (3,)) as cell:
            found = measure_all(cell)
    stiffness = UNITS["metal"].stress_to_mechanical(materials.stiffness(found, 3))
    return np.asarray(stiffness / found.density)


def in_endless_copper(slant: Slant) -> PlaneWaves:
    """The packet, which starts at x = 0, in a body that is longer than its way."""
    far = FAR * slant.deviation * H
    return plane_waves(slant.packet(0.0), squared_speeds(), (-far, far))


def shares_above(waves: PlaneWaves, x: float, times: Floats) -> Floats:
    """Shares of a packet's kinetic energy above x at times, as means over y and over a period."""
    k = waves.k[:, 0]
    far = math.pi / (k[1] - k[0])  # where it repeats
    places = np.linspace(-far, far, PLACES)
    phases, rates = np.exp(1j * np.outer(places, k)), waves.frequency[:, None] * waves.moved
    shares = []
    for time in times:
        field = phases @ (rates * np.exp(-1j * waves.frequency * time)[:, None])
        density = (np.abs(field) ** 2).sum(axis=1)
        shares.append(density[places > x].sum() / density.sum())
    return np.array(shares)


def group_velocity(slant: Slant) -> Floats:
    """Of the carrier (angstrom / ps), by central differences of its frequency."""
    k = 2.0 * math.pi / (slant.length * H) * np.array(slant.packet(0.0).travel(3))
    step = 1e-4 * float(np.linalg.norm(k))
    ends = k + step * np.concatenate([np.eye(3), -np.eye(3)])
    ahead, behind = modes(slant.packet(0.0), squared_speeds(), ends)[0].reshape(2, 3)
    return np.asarray((ahead - behind) / (2.0 * step))


@cache
def force_constants() -> tuple[Floats, Floats]:
    """Places of atoms ``(n, 3)`` relative to the first, and how it is accelerated by their motion.

    By LAMMPS, in a periodic cube of six lattice constants; force constants over mass, shape
    ``(n, 3, 3)`` (1 / ps^2).
    """
    edge, size = CUBE * COPPER.constant, 1e-3
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_scripts(folder)
        script = folder / "cell.in"
        cube = " ".join(f"0 {CUBE}" for _ in range(3))
        script.write_text(script.read_text().replace("0 1 0 1 0 1", cube))
        engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
        engine.script(str(script), {})
        engine.commands(["group first id 1", "run 0 post no"])
        x, mass, forces = engine.vectors_by_id("x"), engine.masses()[0], []
        for step in (*np.eye(3), *-np.eye(3)):
            engine.commands([moved_by(size * step), "run 0 post no"])
            forces.append(engine.vectors_by_id("f"))
            engine.commands([moved_by(-size * step)])
        engine.lammps.close()
    ahead, behind = np.reshape(forces, (2, 3, -1, 3))
    constants = (behind - ahead).swapaxes(0, 1) / (2.0 * size * mass)
    x = x - x[0]
    return x - edge * np.round(x / edge), UNITS["metal"].energy_to_mechanical(constants)


def moved_by(step: Floats) -> str:
    """Command of LAMMPS that moves the first atom (angstrom)."""
    return f"displace_atoms first move {step[0]} {step[1]} {step[2]} units box"


def against_lattice(slant: Slant) -> tuple[float, float]:
    """The carrier's frequency in the lattice over that of its mode, and the energy in the others.

    The energy is the squared sine of the angle between the motions of both.
    """
    k = 2.0 * math.pi / (slant.length * H) * np.array(slant.packet(0.0).travel(3))
    places, constants = force_constants()
    squares, vectors = np.linalg.eigh(np.einsum("n,nij->ij", np.cos(places @ k), constants))
    [frequency], [moved] = modes(slant.packet(0.0), squared_speeds(), k[None])
    shared = (vectors.T @ moved) ** 2
    best = int(np.argmax(shared))
    return float(squares[best] ** 0.5 / frequency), float(1.0 - shared[best])


def leaving_time(slant: Slant, way: float) -> float:
    """When nearly all of the packet would have gone a way downward (angstrom); in whole steps.

    Raises
    ------
    ValueError
        Some of it goes elsewhere, or is too slow.
    """
    step = 0.002 * COPPER.md_steps
    speed = -float(group_velocity(slant)[0])
    times = step * np.arange(math.ceil(way / speed / step), math.ceil(LONG * way / speed / step))
    late = np.flatnonzero(shares_above(in_endless_copper(slant), -way, times) < LEFT)
    if not late.size:
        raise ValueError(f"{slant}: part of it does not leave; take more cycles, or a wider strip")
    return float(times[late[0]])


def slanted_case(slant: Slant, deeper: float = 0.0) -> dict[str, Any]:
    """A packet that leaves a slab of atoms; it may start so many cells deeper inside."""
    half = REACH * slant.deviation
    end = leaving_time(slant, (half + deeper + BEYOND) * H)
    gone = -float(group_velocity(slant)[0]) * end / H
    edge = math.ceil(gone - deeper) + 0.3
    cells = math.ceil(edge + deeper + 2.0 * half)
    case = copper_case((cells, slant.across, THICK), ((edge, cells), None, None), end)
    case["output"] = {"interval": end, "energy_interval": 0.002 * COPPER.md_steps}
    packet = slant.packet((edge + half + deeper) * H)
    case["initial"] = {"packets": [msgspec.to_builtins(packet)]}
    return case


def shares(run: Run) -> list[str]:
    """What comes back and passes, what is taken, and how the energy balances.

    What passes is counted by the kinetic energy of the continuum, and by all its energy.
    """
    reflected, transmitted = crossed(run)
    found = [f"{reflected:.4f}, {transmitted:.4f}, {energies(run)[0][-1]:.4f}"]
    if run.case.coupling.absorber is not None:
        found.append(f"{run.energies.dissipated[-1] / run.energies.energy[0]:.4f}")
    return [*found, f"{run.energies.largest_imbalance():.1e}"]


def row(slant: Slant, absorber: str) -> str:
    """A row of the table."""
    velocity = group_velocity(slant)
    off = math.degrees(math.atan2(velocity[1], -velocity[0]))
    cells = [
        f"{slant.kind} {slant.length:g} h",
        f"{slant.degrees:.1f}; {off:.1f}",
        f"{slant.cycles:g}",
    ]
    with tempfile.TemporaryDirectory() as place:
        for k, setting in enumerate(ABSORBERS[absorber]):
            case = slanted_case(slant, 0.0 if absorber == "off" else DEEPER)
            case["coupling"]["absorber"] = setting
            run = run_case(case, Path(place) / str(k))
            cells += shares(run)
        cells.insert(3, f"{share(run):.2f}")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the rows, one after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.slanted_copper")
    parser.add_argument("waves", nargs="+", metavar="KIND:LENGTH:ACROSS:CYCLES")
    parser.add_argument("--absorber", choices=ABSORBERS, default="off")
    parser.add_argument("--modes", action="store_true", help="compare modes with the lattice's")
    words = parser.parse_args()
    for word in words.waves:
        slant = Slant.of(word)
        if words.modes:
            print("{:.4f} of the frequency, {:.1e}".format(*against_lattice(slant)), flush=True)
        else:
            print(row(slant, words.absorber), flush=True)


if __name__ == "__main__":
    main()
