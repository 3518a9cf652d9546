"""How forces on ghosts may reach the nodes, tried with heat in copper: energy and momentum.

``python -m tests.physics.interface.impulses [--body box] [--end 3.2]`` prints the table of
docs/scheme-fs.md. Both sides run in this process, and ghosts are looked at after every MD step.

Ghosts push the nodes with the forces g at every MD step, and a coupling step has N of them. The
nodes get, in one kick at the end of a coupling step,

- ``now``, dt times the present g, as gimpmd has it;
- ``mean``, dt times the mean of g over the coupling step that has ended;
- ``carried``, ``now``, and what was missing in the step before to the true impulse;
- ``every step``: nodes, and with them ghosts, change their velocities after every MD step, by
  their mass matrix and g alone. All other forces of the nodes act once in a coupling step
  (r-RESPA), and points strain with the mean velocity.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array, diags_array, eye_array

from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.side import ContinuumSide
from gimpmd_gimp.step.dispersion import consistent_mass
from gimpmd_gimp.step.solver import Solver
from gimpmd_md.roles import CORE
from gimpmd_md.side import open_side
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import write_scripts
from tests.measuring import measured
from tests.physics.interface.copper_heat import BODIES, HEAT, MD_STEP, heated, thermal_momentum


@dataclass(frozen=True)
class Window:
    """Forces on nodes in a coupling step: at its start, at its end, their mean, all ``(n, d)``."""

    first: Floats
    last: Floats
    mean: Floats


KINDS: dict[str, Callable[[Window], Floats]] = {
    "now": lambda w: w.last,
    "mean": lambda w: w.mean,
    "carried": lambda w: w.last + w.mean - 0.5 * (w.first + w.last),
    "every step": lambda w: w.mean,
}
"""Force that acts on the nodes in the next kick."""

MOST = 2.0
"""Energy over that of the start at which a run ends."""


class Sums(NamedTuple):
    """Sums over free atoms and points.

    Attributes
    ----------
    energy : of both.
    momentum, spin : momentum and angular momentum of both, shape ``(d,)``.
    exchanged : angular momentum of the atoms, and what they have given to the nodes.
    of_atoms : angular momentum of the atoms.
    """

    energy: float
    momentum: Floats
    spin: Floats
    exchanged: Floats
    of_atoms: Floats


class Both:
    """The atoms and the continuum of a case.

    Parameters
    ----------
    plan : Plan
    kind : str
        Of `KINDS`.
    run_dir : Path
        Relative to the working directory, which holds the scripts.
    """

    def __init__(self, plan: Plan, kind: str, run_dir: Path) -> None:
        (run_dir / "fields").mkdir(parents=True)
        self.plan, self._kind, self._units = plan, kind, UNITS[plan.units]
        self._md = open_side(plan, MPI.COMM_SELF, run_dir)
        self._gimp = Gimp(plan, None, run_dir)
        self._continuum = ContinuumSide(plan, self._gimp)
        self._solver = self._gimp.solver
        self._nodes, self._ghosts = self._continuum._scheme, self._md._scheme
        self._to_md = np.searchsorted(self._continuum.offers, self._md.needs)
        self._to_nodes = np.searchsorted(self._md.offers, self._continuum.needs)
        self._change, self._velocity = inverse_masses(self._solver)
        shared = self._nodes._shared
        self._near = self._velocity[shared][:, shared].toarray()
        self._steps, self._missing = 0, np.zeros((shared.size, plan.dim))
        self._place = self._solver.mesh.positions()[shared] - np.mean(plan.domain.box, axis=1)
        self._given = np.zeros(plan.dim)  # angular momentum, by atoms to nodes
        force = np.zeros_like(self._missing) if kind == "every step" else self._forces()
        self._window = Window(force, force, force)

    @property
    def free_mass(self) -> float:
        """Mass of the free atoms."""
        atoms = self._md.atoms
        return float(atoms.mass[(atoms.role & CORE) != 0].sum())

    def step(self) -> Sums:
        """Take a coupling step; returns the sums at its start."""
        md, continuum, points = self._md, self._continuum, self._solver.points
        self._lag()
        md.finish()
        continuum.finish()
        potential = self._solver.strain_energy()[0] + self._nodes._energy
        x, before = points.x.copy(), points.v.copy()
        force = KINDS[self._kind](self._window)
        continuum.receive({"force": force})
        continuum.advance()
        v = 0.5 * (before + points.v) if self._steps else before
        half = np.cross(self._place, 0.5 * self.plan.step * force).sum(axis=0)
        if self._kind == "every step":  # the impulse of the atoms is over, the rest half done
            self._solver.body.gather(ALL, self._change @ self._all(self.plan.step * force), 0.5, v)
            half[:] = 0.0
        self._given += half * (self._steps > 0)
        sums = self._sums(x, v, potential)
        self._given += half
        self._move(continuum.zone_fields()["velocity"])
        self._steps += 1
        return sums

    def close(self) -> None:
        """Close both codes."""
        self._md.close()
        self._continuum.close()

    def _move(self, V: Floats) -> None:
        """N MD steps, in which ghosts follow nodes that start with velocities ``V (n, d)``."""
        span, responds = self.plan.atoms.timestep, self._kind == "every step"
        first = force = self._forces()
        impulse, moved = np.zeros_like(force), np.zeros_like(force)
        for _ in range(self.plan.atoms.steps):
            kick = np.cross(self._place, force).sum(axis=0)
            impulse += 0.5 * span * force
            moved += span * impulse
            now = V + self._near @ impulse if responds else V
            self._ghosts.drive(now[self._to_md])
            self._md.atoms.run(1)
            self._place += span * now
            force = self._forces()
            impulse += 0.5 * span * force
            kick += np.cross(self._place, force).sum(axis=0)
            self._given += 0.5 * span * kick * responds
        self._md._step += 1
        self._window = Window(first, force, impulse / self.plan.step)
        if responds:
            self._missing = moved / self.plan.step

    def _lag(self) -> None:
        """Let points and nodes move with the mean velocity of the step that has ended."""
        change = self._velocity @ self._all(self._missing)
        self._solver.nodes.V += change
        self._nodes._displacement += self.plan.step * change[self._nodes._nodes]

    def _forces(self) -> Floats:
        """Forces on the nodes now."""
        return np.asarray(self._ghosts.fields(0.0)["force"][self._to_nodes])

    def _all(self, shared: Floats) -> Floats:
        """Values of the shared nodes, among zeros."""
        values = np.zeros((self._solver.mesh.size, self.plan.dim))
        values[self._nodes._shared] = shared
        return values

    def _sums(self, x: Floats, v: Floats, potential: float) -> Sums:
        """Over free atoms and points, which stand at ``x`` with velocities ``v``."""
        atoms, mass = self._md.atoms, self._solver.points.mass[:, None]
        free = (atoms.role & CORE) != 0
        m, va = atoms.mass[free][:, None], atoms.v[free]
        of_atoms, of_points = m * va, mass * v
        center = np.mean(self.plan.domain.box, axis=1)
        spin = np.cross(atoms.x[free] - center, of_atoms).sum(axis=0)
        mechanical = potential + 0.5 * float((of_atoms * va).sum() + (of_points * v).sum())
        bonded = (atoms.role & self._ghosts.bonded) != 0
        energy = self._units.energy_from_mechanical(mechanical) + atoms.potential[bonded].sum()
        return Sums(
            float(energy),
            of_atoms.sum(axis=0) + of_points.sum(axis=0),
            spin + np.cross(x - center, of_points).sum(axis=0),
            spin + self._given,
            spin,
        )


def inverse_masses(solver: Solver) -> tuple[csr_array, csr_array]:
    """Matrices that take impulses on nodes to changes of velocity in a kick, and after it.

    With the consistent mass C, the lumped mass M and ``Q = 1 + beta (1 - M^-1 C)``: ``Q M^-1``, by
    which points are kicked, and ``Q M^-1 C Q M^-1``, by which nodes move. Slaves pass their sums to
    other nodes, and take their values from these.
    """
    mesh, nodes = solver.mesh, solver.nodes
    tied = mesh.constraints
    own = np.setdiff1d(np.arange(mesh.size), tied.node)
    slaves = np.repeat(tied.node, np.diff(tied.start))
    places = np.concatenate([own, slaves]), np.concatenate([own, tied.parent])
    weights = np.concatenate([np.ones(own.size), tied.weight])
    T = csr_array((weights, places), shape=(mesh.size, mesh.size))
    C = consistent_mass(solver.body.stencils, tied, solver.points.mass, mesh.size)
    moves = mesh.basis & (nodes.mass_floor < nodes.M)
    inverse = diags_array(np.divide(1.0, nodes.M, out=np.zeros(mesh.size), where=moves))
    beta = solver.stages._beta
    kick = ((1.0 + beta) * eye_array(mesh.size) - beta * inverse @ C) @ inverse
    return csr_array(T @ kick @ T.T), csr_array(T @ kick @ C @ kick @ T.T)


def try_kind(
    kind: str, body: str, temperature: float, md_steps: int, end: float
) -> tuple[list[Sums], float]:
    """Run a case until the time or an energy is reached; sums by coupling step, and n m."""
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        write_scripts(Path(place))
        Path("heat.in").write_text(HEAT.format(kinetic=2.0 * temperature))
        case = msgspec.convert(heated(body, md_steps, end), Case)
        both = Both(make_plan(measured(case, Path(place))), kind, Path("run"))
        found = [both.step()]
        while len(found) <= round(end / both.plan.step) and found[-1].energy < (
            MOST * found[0].energy
        ):
            found.append(both.step())
        mass = both.free_mass
        both.close()
    return found, mass


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt((values**2).mean()))


def row(kind: str, body: str, temperature: float, md_steps: int, end: float) -> str:
    """A row of the table."""
    sums, mass = try_kind(kind, body, temperature, md_steps, end)
    energy, momentum, spin, exchanged, of_atoms = (
        np.array(each) for each in zip(*sums, strict=True)
    )
    relative = energy[1:] / energy[0] - 1.0
    first, last = (part.mean() for part in (relative[: relative.size // 4], relative[-10:]))
    scale = thermal_momentum(mass, temperature, UNITS["metal"])
    turns = rms(of_atoms - of_atoms[0])  # without meaning where the body is periodic
    cells = (
        kind,
        body,
        str(md_steps),
        f"{relative.size * md_steps * MD_STEP:.1f} ps",
        f"{first:.1e}",
        f"{last:.1e}",
        f"{rms(momentum - momentum[0]) / scale:.1e}",
        *("" if body == "slab" else f"{rms(L - L[0]) / turns:.1e}" for L in (exchanged, spin)),
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table, one row after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.impulses")
    parser.add_argument("--body", choices=tuple(BODIES), default="box")
    parser.add_argument("--kind", choices=tuple(KINDS), action="append")
    parser.add_argument("--temperature", type=float, default=300.0)
    parser.add_argument("--steps", type=int, default=16, help="MD steps in a coupling step")
    parser.add_argument("--end", type=float, default=3.2, help="picoseconds")
    words = parser.parse_args()
    print(
        "| nodes get | body | N | time | energy over that of the start, less 1: mean of the first "
        "quarter | of the last ten steps | momentum over sqrt(n m k T), rms | angular "
        "momentum of the atoms and what the nodes have got, change over that of the atoms, rms "
        "| the same of atoms and points |"
    )
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    for kind in words.kind or KINDS:
        print(row(kind, words.body, words.temperature, words.steps, words.end), flush=True)


if __name__ == "__main__":
    main()
