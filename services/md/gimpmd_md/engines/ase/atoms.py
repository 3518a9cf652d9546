"""Atoms whose forces come from a calculator of ASE; gimpmd itself integrates their motion.

One rank holds all atoms. In two dimensions the atoms keep their positions normal to the plane: they
are a flat sheet, or a crystal that repeats along this direction and whose layers are mirror planes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import ase
import numpy as np

from gimpmd_md.engines.ase.dump import IN_PLANE, IN_SPACE, append_frame, begin_dump
from gimpmd_md.engines.ase.input import calculator_maker, read_input
from gimpmd_md.engines.ase.potential import Potential, check_range, is_pairwise
from gimpmd_md.engines.ase.structure import make_structure
from gimpmd_md.engines.atoms import Array, Spring
from gimpmd_md.roles import BOUNDARY
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.files import cut_file
from gimpmd_schemas.checkpoint.states import TOTAL, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.registry import Abilities

_BOX_VARIABLE = re.compile(r"[xyz](lo|hi)\d*")

_KEPT = ("site", "x", "v", "rest", "last", "preload", "external", "potential", "_at_rest")
"""Values of single atoms that belong to a saved state."""

OUT_OF_PLANE = 1e-6
"""Largest force out of the plane, over C11 times the cutoff (to the power d - 1)."""


class AseAtoms:
    """The atoms of a run; see `engines.atoms.Atoms`.

    Positions are never wrapped, and atoms never change their order.

    Parameters
    ----------
    plan : Plan
        ``plan.atoms.input`` is a YAML file (`input.Input`) in the working directory.
    comm : mpi4py communicator
        Of one rank.
    run_dir : Path
        Folder of the run, relative to the working directory.

    Raises
    ------
    BackendError
        The input is wrong, or the calculator does not fit the run.
    """

    abilities: ClassVar[Abilities] = Abilities(
        dimensions=(2, 3),
        materials="any calculator of ASE; coupling.scheme: force needs a sum over pairs",
        schemes=("force", "velocity", "paper"),
        ranks=1,
        checkpoint=True,
    )
    migrations = 0
    fix_work = 0.0
    notes: tuple[str, ...] = ()

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        self._plan, self.comm, self._name = plan, comm, plan.atoms.input
        self.cutoff = _check_plan(plan, comm)
        given = read_input(self._name, plan.dim)
        self._make = calculator_maker(self._name, given)
        self._structure = make_structure(plan, given, self.cutoff)
        tester = self._make()
        check_range(self._name, self._structure, tester, self.cutoff)
        self.pairwise = is_pairwise(self._name, self._structure, tester, self.cutoff)
        self._ghosts: Potential | None = None
        self._boundary = np.zeros(len(self._structure), dtype=np.bool_)
        self._make_potentials()
        self._check_energies()
        self._dump = run_dir / "atoms" / "atoms.dump"
        self._step = 0  # coupling steps
        n, d = len(self._structure), plan.dim
        self.site = self._structure.positions[:, :d].copy()
        self.x, self.rest, self.last = (self.site.copy() for _ in range(3))
        self.v, self.f, self.external, self.preload = (np.zeros((n, d)) for _ in range(4))
        self.mass = self._structure.get_masses()
        self.role = np.zeros(n, dtype=np.int32)
        self.potential, self._at_rest = np.zeros(n), np.zeros(n)
        self._per_mass = UNITS[plan.units].force_to_mechanical(1.0) / self.mass[:, None]
        self._hold, self._loaded = np.zeros((n, d)), np.zeros((n, 1), dtype=np.bool_)

    @staticmethod
    def version() -> str:
        """Name and version of ASE."""
        return f"ase {ase.__version__}"

    # --- life ------------------------------------------------------------------------------

    def settle(
        self,
        springs: Sequence[Spring],
        loaded: int,
        counted: int,
        tolerance: float | None,
        saved: SavedStates | None = None,
    ) -> None:
        """Relax the free atoms, note positions and energies at rest, and attach the springs."""
        self._step = saved.step if saved else 0
        self._boundary = (self.role & BOUNDARY) != 0
        self._loaded = ((self.role & loaded) != 0)[:, None]
        self._make_potentials()
        if tolerance is not None:
            free = ~self._boundary
            self._all.move(self.x)
            self.x[:] = self._all.relax(free, self._plan.dim, self.cutoff, tolerance)
        self.rest[:] = self.x
        self._sum_forces()
        self._at_rest[:] = self._energies()
        for spring in springs:
            self._hold[(self.role & spring.bit) != 0, spring.axis] += spring.stiffness

    def start(self) -> None:
        """Compute forces and energies, and write the first frame."""
        self._sum_forces()
        self._check_plane()
        self.potential[:] = self._energies() - self._at_rest
        if not self._step:
            begin_dump(self._dump)
            self._write()

    def run(self, steps: int) -> None:
        """Velocity Verlet, as LAMMPS does it; boundary atoms keep their velocity."""
        dt = self._plan.atoms.timestep
        kick = np.where(self._boundary[:, None], 0.0, 0.5 * dt * self._per_mass)
        for _ in range(steps):
            self.v += kick * self.f
            self.x += dt * self.v
            self._sum_forces()
            self.v += kick * self.f
        self._step += 1
        is_output = self._plan.is_output(self._step)
        if is_output or self._step % self._plan.energies_every == 0:
            self.potential[:] = self._energies() - self._at_rest
        if is_output:
            self._write()

    def renew(self) -> None:
        """Make calculators anew: their neighbour lists depend on earlier positions."""
        self._make_potentials()
        self._sum_forces()

    def state(self) -> dict[str, Array]:
        """Values of the atoms, and the length of the dump so far."""
        found: dict[str, Array] = {name: getattr(self, name) for name in _KEPT}
        return found | {TOTAL + "dump_bytes": np.asarray(self._dump.stat().st_size)}

    def restore(self, saved: SavedStates) -> None:
        """Give the atoms their saved values, and cut the dump."""
        if not np.array_equal(saved.own["site"], self.site):
            raise BackendError(f"{self._name} makes other atoms than before the checkpoint")
        for name in _KEPT:
            getattr(self, name)[:] = saved.own[name]
        cut_file(self._dump, int(saved.total("dump_bytes")))
        self.renew()

    def close(self) -> None:
        """No file is open."""

    # --- forces and energies -----------------------------------------------------------------

    def _make_potentials(self) -> None:
        """Make the calculators of all atoms and, for a sum over pairs, of the boundary atoms."""
        self._all = Potential(self._name, self._structure, self._make())
        if self.pairwise and self._boundary.any():
            self._ghosts = Potential(self._name, self._structure[self._boundary], self._make())

    def _sum_forces(self) -> None:
        """Forces of the potential, of springs and from outside, at the present positions."""
        self.f[:] = self._forces()
        self.f += np.where(self._loaded, self.external, 0.0)
        self.f -= self._hold * (self.x - self.rest)

    def _forces(self) -> Floats:
        """Forces of the potential; without those among boundary atoms if it is a sum over pairs."""
        self._all.move(self.x)
        f = self._all.forces()[:, : self._plan.dim].copy()
        if self._ghosts is not None:
            self._ghosts.move(self.x[self._boundary])
            f[self._boundary] -= self._ghosts.forces()[:, : self._plan.dim]
        return f

    def _energies(self) -> Floats:
        """Potential energy of every atom, at the positions of the last forces.

        A calculator may know only the sum. Then every atom gets an equal share.
        """
        if self._all.has("energies"):
            energies = self._all.energies().copy()
            if self._ghosts is not None:
                energies[self._boundary] -= self._ghosts.energies()
            return energies
        whole = self._all.energy() - (self._ghosts.energy() if self._ghosts else 0.0)
        return np.full(len(self.x), whole / len(self.x))

    # --- checks ------------------------------------------------------------------------------

    def _check_energies(self) -> None:
        coupling = self._plan.coupling
        if coupling is None or coupling.scheme == "force" or self._all.has("energies"):
            return
        raise BackendError(
            f"{self._name}: the calculator gives no energies of single atoms, which "
            f"coupling.scheme: {coupling.scheme} needs for the atoms inside the zones; use another "
            "calculator, or coupling.scheme: force with a sum over pairs"
        )

    def _check_plane(self) -> None:
        """Check that nothing pushes the atoms out of the plane in which they are kept."""
        plan = self._plan
        if plan.dim == 3:
            return
        stiffness = float(plan.stiffness()[0, 0]) / UNITS[plan.units].nktv2p
        force = float(np.abs(self._all.forces()[:, 2]).max())
        if force > OUT_OF_PLANE * stiffness * self.cutoff:
            raise BackendError(
                f"{self._name}: a force of {force:.3g} pushes atoms out of the plane in which they "
                "are kept; the layers of the crystal must be mirror planes of it"
            )

    # --- output ------------------------------------------------------------------------------

    def _write(self) -> None:
        """Append a frame to the dump. Stress is nan if the calculator gives none for an atom."""
        plan, dim = self._plan, self._plan.dim
        vectors, names, order = IN_PLANE if dim == 2 else IN_SPACE
        position = self._structure.positions.copy()
        position[:, :dim] = self.x
        _, kinds = np.unique(self._structure.numbers, return_inverse=True)
        columns: dict[str, Floats | Ints] = {"id": np.arange(1, len(self.x) + 1), "type": kinds + 1}
        columns |= dict(zip("xyz", position.T, strict=True))
        values = np.hstack([self.v, self.x - self.rest, self.site]).T
        columns |= dict(zip(vectors.split(), values, strict=True))
        columns |= dict(zip(names, self._stresses()[:, order].T, strict=True))
        if self._all.has("energies"):
            columns["potential_energy"] = self.potential + self._at_rest
        columns["mass"] = self.mass
        step = self._step * plan.atoms.steps
        append_frame(self._dump, step, self._box(position), self._structure.pbc, columns)

    def _stresses(self) -> Floats:
        """Stress times area or volume of every atom (pressure units), ``(n, 6)``."""
        if not self._all.has("stresses"):
            return np.full((len(self.x), 6), np.nan)
        virials = self._all.virials()
        if self._ghosts is not None:
            virials[self._boundary] -= self._ghosts.virials()
        return virials * UNITS[self._plan.units].nktv2p

    def _box(self, position: Floats) -> Floats:
        """Box of the dump: the period along periodic axes, and around the atoms along others."""
        low = np.zeros(3)
        low[: self._plan.dim] = [start for start, _ in self._plan.domain.box]
        periodic: Bools = self._structure.pbc
        low = np.where(periodic, low, position.min(axis=0) - self.cutoff)
        lengths = self._structure.cell.lengths()
        high = np.where(periodic, low + lengths, position.max(axis=0) + self.cutoff)
        return np.column_stack([low, high])


def _check_plan(plan: Plan, comm: Any) -> float:
    """Check what a run with ASE needs of the case; returns the cutoff."""
    md = plan.atoms
    if plan.units not in ("metal", "lj"):
        raise BackendError(
            f"units: {plan.units}: calculators of ASE work in eV and Angstrom; write units: metal, "
            "or lj for a calculator with reduced parameters"
        )
    if comm.size != 1:
        raise BackendError(
            f"md.ranks = {comm.size}: md.backend: ase runs on one rank; set md.ranks: 1 "
            "(a calculator may use threads or a GPU of its own)"
        )
    if md.after is not None:
        raise BackendError(
            f"md.after = {md.after!r} is a LAMMPS script; leave it out with md.backend: ase"
        )
    own = sorted(key for key in md.variables if not _BOX_VARIABLE.fullmatch(key))
    if own:
        raise BackendError(
            f"md.variables: {own[0]} is a LAMMPS variable; with md.backend: ase write values into "
            f"{md.input}"
        )
    if md.cutoff is None:
        raise BackendError(
            "md.cutoff: md.backend: ase needs the range of the potential; a calculator does not "
            "tell it"
        )
    return md.cutoff
