"""Atoms in LAMMPS: what is special about LAMMPS and belongs to no other MD code.

Each rank holds one patch. Values that must travel with an atom when LAMMPS moves it to another rank
are per-atom properties of LAMMPS, so no Python state refers to single atoms.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.engines.atoms import Array, Spring
from gimpmd_md.engines.lammps.fix_work import OWN, FixWork, not_covered
from gimpmd_md.engines.lammps.notes import notes_on
from gimpmd_md.engines.lammps.off_types import double_types
from gimpmd_md.engines.lammps.random_fixes import RandomFix, not_repeated, random_fixes
from gimpmd_md.engines.lammps.script import Script, build, cutoff_of, refuse_integrators
from gimpmd_md.engines.lammps.site_key import SiteKey
from gimpmd_md.rest_stress import AtRest, note_at_rest
from gimpmd_md.roles import BOUNDARY, CORE, OFF
from gimpmd_md.sums import extent
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.files import cut_file
from gimpmd_schemas.checkpoint.states import TOTAL, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.registry import Abilities

ROLE, SITE, REST, LAST, PRELOAD = (
    "i_gimpmd_role",
    "d2_gimpmd_site",
    "d2_gimpmd_rest",
    "d2_gimpmd_last",
    "d2_gimpmd_preload",
)
"""Per-atom properties of LAMMPS: see the attributes of `engines.atoms.Atoms`."""

LOG_BYTES = 10_000_000
"""What LAMMPS may add to its log while the run goes on: it writes 200 bytes at each coupling step,
even if there is nothing to say."""

_RUNS_BETWEEN_TRIMS = 1000
_ENERGY_AT_REST = "d_gimpmd_pe0"
_KEPT = ("x", "v", "image", ROLE, _ENERGY_AT_REST, SITE, REST, LAST, PRELOAD)
"""Values of single atoms that belong to a saved state."""

_SORT_EVERY = 1000
"""MD steps between sortings of the atoms, as LAMMPS has it."""

_BIN = 0.4
"""Edge of the bins for sorting, in distances of nearest neighbours: two atoms share no bin."""

_MOST_BINS = 1e8

_EXTERNAL = "gimpmd_traction"

_AXES = "xyz"
_PLANE = "fix gimpmd_plane all enforce2d"
"""Keeps the atoms of a two-dimensional case in their plane."""

_STRESS = {"xx": 1, "yy": 2, "zz": 3, "yz": 6, "xz": 5, "xy": 4}
"""Columns of LAMMPS's per-atom stress by component."""


class LammpsAtoms:
    """The atoms of one patch in LAMMPS; see `engines.atoms.Atoms`.

    The user's scripts are read in the working directory.

    Parameters
    ----------
    plan : Plan
    comm : mpi4py communicator
        One rank per patch.
    run_dir : Path
        Folder of the run, relative to the working directory and without spaces: LAMMPS would break
        names with spaces.

    Attributes
    ----------
    engine : Engine
        The LAMMPS instance.
    migrations : int
        Changes when LAMMPS has made new neighbour lists.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or its atoms do not fit the case.
    """

    abilities: ClassVar[Abilities] = Abilities(
        dimensions=(2, 3),
        materials="any pair style of LAMMPS; coupling.scheme: force needs a sum over pairs, and "
        "coupling.scheme: sites a style whose sites can be switched off",
        schemes=("force", "sites", "velocity", "paper"),
        ranks=None,
        checkpoint=True,
    )

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        self._plan, self.comm = plan, comm
        self._dump = run_dir / "atoms" / "atoms.dump"
        log = run_dir / "logs" / "log.lammps"
        for path in (self._dump, log):
            path.parent.mkdir(parents=True, exist_ok=True)
        script = Script.of_plan(plan)
        self.engine = build(script, comm, log, plan.atoms.patches)
        self.cutoff = cutoff_of(script, self.engine)
        self.pairwise = self.engine.is_pairwise()
        self._dim = plan.dim
        self._fix_work: FixWork | None = None
        self._random_fixes: tuple[RandomFix, ...] = ()
        self.notes = notes_on(script.path, plan.units, self.engine, self.cutoff)
        self._types = 0  # of atoms whose sites are on, if sites can be off
        if plan.coupling is not None and plan.coupling.scheme == "sites":
            self._types = double_types(script.path, self.engine, run_dir / "atoms").types
        self._loaded = self._done = 0
        self.migrations = self._lists = self._runs = 0
        kept = (SITE, REST, LAST, PRELOAD)
        vectors = " ".join(f"{name} {self._dim}" for name in kept)
        self.engine.commands(
            [
                f"fix gimpmd_atoms all property/atom {ROLE} {_ENERGY_AT_REST} {vectors}",
                "run 0 post no",  # wraps and distributes the atoms
            ]
        )
        self.site[:] = self.x
        self._measure_bins()

    @staticmethod
    def version() -> str:
        """Name and version of LAMMPS."""
        return f"lammps {importlib.metadata.version('lammps')}"

    # --- arrays ----------------------------------------------------------------------------

    @property
    def x(self) -> Floats:
        """Positions."""
        return self.engine.vectors("x")

    @property
    def v(self) -> Floats:
        """Velocities."""
        return self.engine.vectors("v")

    @property
    def f(self) -> Floats:
        """Forces."""
        return self.engine.vectors("f")

    @property
    def mass(self) -> Floats:
        """Masses."""
        return self.engine.masses()

    @property
    def role(self) -> Ints:
        """Role bits."""
        return self.engine.atoms(ROLE)

    @property
    def site(self) -> Floats:
        """Lattice positions."""
        return self.engine.vectors(SITE)

    @property
    def rest(self) -> Floats:
        """Positions at rest."""
        return self.engine.vectors(REST)

    @property
    def last(self) -> Floats:
        """Positions at the start of the coupling step."""
        return self.engine.vectors(LAST)

    @property
    def preload(self) -> Floats:
        """Constant forces near faces with a prescribed motion."""
        return self.engine.vectors(PRELOAD)

    @property
    def external(self) -> Floats:
        """Forces on the loaded atoms.

        LAMMPS keeps them with the atoms. Forces from a LAMMPS variable would make it tally energy
        and stress of every atom at every step, at half the speed.
        """
        return self.engine.external_forces(_EXTERNAL)[:, : self._dim]

    @property
    def potential(self) -> Floats:
        """Potential energies above those at rest."""
        return self.engine.stored("gimpmd_energy") - self.engine.atoms(_ENERGY_AT_REST)

    @property
    def fix_work(self) -> float:
        """Work of the fixes of ``md.after``."""
        return self._fix_work.total if self._fix_work else 0.0

    # --- life ------------------------------------------------------------------------------

    def settle(
        self,
        springs: Sequence[Spring],
        loaded: int,
        counted: int,
        tolerance: float | None,
        saved: SavedStates | None = None,
    ) -> None:
        """Make groups by role, relax, note positions and energies at rest; then ``md.after``."""
        self._loaded = loaded
        self._done = saved.step * self._plan.atoms.steps if saved else 0
        self.migrations += 1
        self._make_groups()
        self._set_thermo()
        if saved:
            self._put_at_rest(saved)
        elif tolerance is not None:
            self._relax(tolerance)
        self._note_rest()
        self._set_step()
        self._attach(springs)
        coupling = self._plan.coupling
        if coupling is not None and coupling.scheme not in AT_PLANES:
            self.notes += note_at_rest(self._plan, self._at_rest(), self.comm)
        if self._plan.atoms.after is not None:
            self._run_after(self._plan.atoms.after, counted)

    def start(self) -> None:
        """Set forces, time integration and output; then compute the forces."""
        self._find_random_fixes()
        self._set_forces()
        self._set_integration()
        self._set_output()
        self._set_tally()
        self.engine.commands(["run 0 post no"])
        self.engine.bound_log(LOG_BYTES)
        self.migrations += 1

    def run(self, steps: int) -> None:
        """Take MD steps."""
        if self._fix_work:
            self._fix_work.begin(self.role, self.v)
        self.engine.commands([f"run {steps} pre no post no"])
        lists = int(self.engine.thermo("nbuild"))  # since `start`, the same on all ranks
        if lists != self._lists:  # atoms move to other ranks when LAMMPS makes neighbour lists
            self.migrations += 1
            self._lists = lists
        self._runs += 1
        if self._runs % _RUNS_BETWEEN_TRIMS == 0:
            self.engine.trim_log()
        if self._fix_work:
            self._fix_work.end(self.role, self.v)

    def renew(self) -> None:
        """Sort the atoms, and make neighbour lists, random numbers and forces anew.

        In bins with one atom at most, the order of the atoms follows from their positions alone.
        The bins of LAMMPS, to which they are then sorted, suit the cache better: with the fine ones
        a step takes 2 % longer.
        """
        step = self.engine.lammps.extract_global("ntimestep")
        self.engine.commands(
            [
                *(command for fix in self._random_fixes for command in fix.anew(step)),
                f"atom_modify sort {_SORT_EVERY} {self._bin!r}",
                "run 0 post no",
                f"atom_modify sort {_SORT_EVERY} 0.0",
                "run 0 post no",
            ]
        )
        self.migrations += 1
        self._lists = int(self.engine.thermo("nbuild"))

    def state(self) -> dict[str, Array]:
        """Values of the atoms; the work of fixes; and the length of the dump so far."""
        found = {name: values.copy() for name, values in self._kept().items()}
        length = self._dump.stat().st_size if self.comm.rank == 0 else 0
        found[TOTAL + "fix_work"] = np.asarray(self.fix_work)
        found[TOTAL + "dump_bytes"] = np.asarray(length)
        return found

    def restore(self, saved: SavedStates) -> None:
        """Give each atom its saved values, send it to its rank, and cut the dump.

        Atoms are known by their lattice positions: their ids depend on the number of ranks.
        """
        self._take(saved, self._kept())
        # the only command that sends atoms to ranks that are far away
        self.engine.commands(["displace_atoms all move 0.0 0.0 0.0 units box"])
        self.renew()
        if self._fix_work:
            self._fix_work.total = float(saved.total("fix_work"))
        length = int(saved.total("dump_bytes"))
        if self.comm.rank == 0:
            cut_file(self._dump, length)

    def close(self) -> None:
        """Close LAMMPS and its files."""
        self.engine.close()

    # --- in order of use -------------------------------------------------------------------

    def _kept(self) -> dict[str, Array]:
        """Writable views of the values of the atoms that belong to a saved state."""
        kept = {name: self.engine.atoms(name) for name in ("id", *_KEPT)}
        if self._loaded:
            kept["external"] = self.engine.external_forces(_EXTERNAL)
        return kept

    def _take(self, saved: SavedStates, values: Mapping[str, Array]) -> None:
        """Fill arrays, by the names of the saved ones, with the values of the atoms."""
        count, key = 0, SiteKey(self.site, self._plan.domain, self._distance)
        for part in saved.parts():
            rows, here = key.rows(part[SITE])
            count += len(rows)
            for name, array in values.items():
                array[rows] = part[name][here].reshape(array[rows].shape)
        if count != len(self.site):
            raise BackendError(
                f"the checkpoint has {count} of the {len(self.site)} atoms of this rank: the "
                f"script {self._plan.atoms.input} makes other atoms than before"
            )

    def _measure_bins(self) -> None:
        """Find the edge of bins that hold one atom at most."""
        site = self.site
        nearest = cKDTree(site).query(site, k=2)[0][:, 1].min() if len(site) > 1 else np.inf
        low, high = extent(self.comm, site)
        self._distance = min(self.comm.allgather(float(nearest)))
        least = (np.prod(high - low) / _MOST_BINS) ** (1.0 / self._dim)
        self._bin = max(_BIN * self._distance, float(least))

    def _make_groups(self) -> None:
        engine = self.engine
        self._group("gimpmd_boundary", BOUNDARY)
        engine.commands(["group gimpmd_free subtract all gimpmd_boundary"])
        if self._types:
            role = self.role
            self.engine.atoms("type")[(role & OFF) != 0] += self._types
            self._group("gimpmd_off", OFF)
            # pairs of two such atoms have no energy
            engine.commands(["neigh_modify exclude group gimpmd_off gimpmd_off"])
        elif self.pairwise:
            # forces among boundary atoms move nothing: these pairs are left out
            engine.commands(["neigh_modify exclude group gimpmd_boundary gimpmd_boundary"])
        self._group("gimpmd_surface", self._loaded)

    def _set_thermo(self) -> None:
        every = self._steps_between_tallies()
        unwrapped = " ".join(f"{axis}u" for axis in _AXES[: self._dim])
        self.engine.commands(
            [
                "compute gimpmd_pe all pe/atom pair bond angle dihedral improper kspace",
                f"compute gimpmd_xu all property/atom {unwrapped}",
                "thermo_style custom step time temp ke",
                "thermo_modify norm no lost error",
                # LAMMPS moves the next output to the last step of a run, and tallies energy and
                # stress of every atom there, which takes as long as two steps; not so if a
                # variable says when it comes
                f"variable gimpmd_thermo equal (floor(step/{every})+1)*{every}",
                "thermo v_gimpmd_thermo",
                *([_PLANE] if self._dim == 2 else []),
            ]
        )

    def _relax(self, tolerance: float) -> None:
        self.engine.commands(
            [
                "fix gimpmd_hold gimpmd_boundary setforce 0.0 0.0 0.0",
                "min_style cg",
                "min_modify norm max",
                f"minimize 0.0 {tolerance!r} 10000 100000",
                "unfix gimpmd_hold",
            ]
        )

    def _put_at_rest(self, saved: SavedStates) -> None:
        """Put the atoms where they were at rest: relaxing a large crystal takes minutes."""
        self.engine.commands(["run 0 post no"])
        periods = self.engine.per_atom("gimpmd_xu", self._dim) - self.x
        rest = np.empty_like(periods)
        self._take(saved, {REST: rest})
        self.x[:] = rest - periods

    def _attach(self, springs: Sequence[Spring]) -> None:
        """Hang atoms on springs where they are now."""
        for spring in springs:
            axis, group = _AXES[spring.axis], f"gimpmd_spring_{spring.bit.bit_length()}"
            self._group(group, spring.bit)
            self.engine.commands(
                [f"fix {group}{axis} {group} spring/self {spring.stiffness!r} {axis}"]
            )

    def _note_rest(self) -> None:
        engine = self.engine
        engine.commands(["reset_timestep 0", _tallying(1), "run 0 post no"])
        self.rest[:] = engine.per_atom("gimpmd_xu", self._dim)
        engine.atoms(_ENERGY_AT_REST)[:] = engine.stored("gimpmd_energy")
        engine.commands(["unfix gimpmd_energy"])

    def _set_step(self) -> None:
        """Count steps from those of the checkpoint on, and time with them."""
        done = self._done
        if done:
            time = done * self._plan.atoms.timestep
            self.engine.commands([f"reset_timestep {done} time {time!r}"])

    def _at_rest(self) -> AtRest:
        """Atoms and their stress at rest."""
        engine = self.engine
        columns = [f"c_gimpmd_stress[{_STRESS[ij]}]" for ij in self._components()]
        engine.commands(
            [
                "compute gimpmd_stress all stress/atom NULL virial",
                f"fix gimpmd_stress all ave/atom 1 1 1 {' '.join(columns)}",
                "run 0 post no",
            ]
        )
        stress = engine.stored("gimpmd_stress", len(columns))
        found = AtRest(
            cutoff=self.cutoff,
            role=self.role.copy(),
            site=self.site.copy(),
            mass=self.mass.copy(),
            stress=stress.copy(),
        )
        engine.commands(["unfix gimpmd_stress", "uncompute gimpmd_stress"])
        return found

    def _run_after(self, script: str, counted: int) -> None:
        """Run the script ``md.after``, and prepare to measure the work of its fixes."""
        plan, earlier = self._plan, self._users_fixes()
        self._group("gimpmd_core", CORE)
        self._group("gimpmd_counted", counted)
        self._fix_work = FixWork(
            self.engine, self._dim, plan.units, plan.atoms.timestep, plan.atoms.steps, counted
        )
        self._fix_work.open()
        self.engine.script(script, {})
        if self.engine.lammps.extract_global("ntimestep") == 0:  # the script has taken steps
            self._set_step()
        refuse_integrators(script, self.engine)
        added = {n: style for n, style in self._users_fixes().items() if n not in earlier}
        self.notes += tuple(not_covered(script, added, late=True))
        self._fix_work.close("gimpmd_counted", "gimpmd_core")

    def _users_fixes(self) -> dict[str, str]:
        """Names and styles of the fixes that are not gimpmd's own."""
        return {n: style for n, style in self.engine.fixes().items() if not n.startswith(OWN)}

    def _find_random_fixes(self) -> None:
        """Find the fixes that get new seeds in `renew`, and name those that cannot."""
        fixes = self._users_fixes()
        self._random_fixes = random_fixes(self.engine, fixes)
        self.notes += not_repeated(fixes, self._random_fixes)

    def _set_forces(self) -> None:
        """Tractions, and the forces by which a face moves the springs of its atoms."""
        if self._loaded:
            self.engine.commands([f"fix {_EXTERNAL} gimpmd_surface external pf/array 1"])

    def _set_integration(self) -> None:
        self.engine.commands(
            [
                f"timestep {self._plan.atoms.timestep!r}",
                "run_style verlet",
                "fix gimpmd_free gimpmd_free nve",
                "fix gimpmd_boundary gimpmd_boundary nve/noforce",
            ]
        )
        if self._dim == 2:
            # the last fix must be the one that keeps the plane
            keep = [] if self._is_flat() else [_PLANE]
            self.engine.commands(["unfix gimpmd_plane", *keep])

    def _is_flat(self) -> bool:
        """Whether nothing ever pushes the atoms out of the plane.

        Forces of the potential lie in the plane of the atoms; forces of the user's fixes may not. A
        fix that keeps the atoms in the plane costs 3 % of LAMMPS's time.
        """
        z, vz = (self.engine.atoms(name).reshape(-1, 3)[:, 2:] for name in "xv")
        low, high = extent(self.comm, z)
        moving = self.comm.allreduce(int(np.count_nonzero(vz)))
        return not self._users_fixes() and not moving and bool(low[0] == high[0])

    def _set_output(self) -> None:
        """Dump positions, displacements from rest, velocities, stress, mass, energy of atoms.

        The stress of an atom is given times its area, in three dimensions times its volume.
        """
        plan, md_steps = self._plan, self._plan.atoms.steps
        every, last = plan.output_every * md_steps, plan.steps * md_steps
        axes, size = _AXES[: self._dim], "area" if self._dim == 2 else "volume"
        columns = {
            **{f"v_gimpmd_u{axis}": f"u{axis}" for axis in axes},
            **{f"{SITE}[{k}]": f"{axis.upper()}0" for k, axis in enumerate(axes, 1)},
            **{f"c_gimpmd_stress[{_STRESS[ij]}]": f"s{ij}_{size}" for ij in self._components()},
            "c_gimpmd_pe": "potential_energy",
        }
        velocity = " ".join(f"v{axis}" for axis in axes)
        names = " ".join(f"colname {column} {name}" for column, name in columns.items())
        dump = f"dump gimpmd all custom {every} {self._dump}"
        append = ["dump_modify gimpmd append yes"] if self._done else []
        self.engine.commands(
            [
                "compute gimpmd_stress all stress/atom NULL virial",
                *(
                    f'variable gimpmd_u{axis} atom "c_gimpmd_xu[{k}]-{REST}[{k}]"'
                    for k, axis in enumerate(axes, 1)
                ),
                f"{dump} id type x y z {velocity} {' '.join(columns)} mass",
                f"dump_modify gimpmd sort id format float %.9g {names}",
                *append,
                *_ending_with(last, every, first=not self._done),
            ]
        )

    def _set_tally(self) -> None:
        """Let LAMMPS tally energies of atoms only at the times at which they are needed.

        Raises
        ------
        BackendError
            Steps are no longer counted from 0.
        """
        step = self.engine.lammps.extract_global("ntimestep")
        if step != self._done:
            raise BackendError(
                f"{self._plan.atoms.after}: LAMMPS is at step {step}, not {self._done}, after this "
                "script; end it with reset_timestep 0"
            )
        self.engine.commands([_tallying(self._steps_between_tallies())])

    # --- helpers ---------------------------------------------------------------------------

    def _components(self) -> list[str]:
        """Components of a stress in Voigt order."""
        return [_AXES[i] + _AXES[j] for i, j in VOIGT[self._dim]]

    def _steps_between_tallies(self) -> int:
        """MD steps between the times at which energies are needed."""
        return self._plan.energies_every * self._plan.atoms.steps

    def _group(self, name: str, bits: int) -> None:
        """Make a LAMMPS group of the atoms that have one of the bits."""
        single = [1 << place for place in range(bits.bit_length()) if bits >> place & 1]
        formula = "+".join(f"(floor({ROLE}/{bit})%2)" for bit in single) or "0.0"
        self.engine.commands(
            [
                f'variable gimpmd_member atom "{formula}"',
                f"group {name} variable gimpmd_member",
                "variable gimpmd_member delete",
            ]
        )


def _ending_with(last: int, every: int, first: bool) -> list[str]:
    """Commands that make LAMMPS dump once in ``every`` steps and at the last step.

    ``first`` says whether it dumps at once too.
    """
    if first and last % every == 0:
        return []
    following = f"(floor(step/{every})+1)*{every}"
    return [
        f"variable gimpmd_dump equal ternary(step<{last}&&{following}>{last},{last},{following})",
        f"dump_modify gimpmd every v_gimpmd_dump first {'yes' if first else 'no'}",
    ]


def _tallying(every: int) -> str:
    """Command that makes LAMMPS keep the energy of every atom, once in ``every`` steps.

    LAMMPS's own output would need energies at the end of every run, and a step that tallies them
    takes about twice as long as others.
    """
    return f"fix gimpmd_energy all ave/atom {every} 1 {every} c_gimpmd_pe"
