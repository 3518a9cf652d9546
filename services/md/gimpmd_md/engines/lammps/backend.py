"""LAMMPS as the atomistic side of the coupling, whatever the scheme.

Building, relaxing, loads, driven faces, output and energies are here; what crosses the interface is
the business of an ``exchange.Exchange``. Each rank holds one patch. What must travel with an atom
when LAMMPS moves it to another rank is kept in per-atom properties of LAMMPS itself, so no Python
state refers to single atoms. Within the N steps of a window no Python runs: boundary atoms keep the
velocity they were given.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.coupling.force import ForceExchange
from gimpmd_md.coupling.halo import own_patch
from gimpmd_md.coupling.scheme import BOUNDARY, CORE, Exchange
from gimpmd_md.coupling.velocity import VelocityExchange
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.script import build, check_cutoff, extent, refuse_integrators
from gimpmd_md.loads import RimFace, rim_faces
from gimpmd_md.sums import mean_velocity, periods, power, tally
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

_SURFACE, _LAYER = 8, 128
"""First of four bits of ``i_gimpmd_part`` each, one per face: carries its traction; follows its
velocity. The bits before are the exchange's."""

FORCE_TOLERANCE = 1e-6
"""Relaxation ends when no force exceeds this times C11 times the spacing."""


class LammpsBackend:
    """The atoms of one patch in LAMMPS; see ``backend.MdBackend``.

    Scripts are read in the working directory.

    Parameters
    ----------
    case : Case
        With explicit moduli.
    comm : mpi4py communicator
        One rank per patch.
    log, dump : Path
        LAMMPS's log, and the dump of the atoms; relative to the working directory, and without
        spaces.

    Attributes
    ----------
    engine : Engine
        The LAMMPS instance.

    Raises
    ------
    BackendError
        LAMMPS refuses a script, or its atoms do not fit the case.
    """

    def __init__(self, case: Case, comm: Any, log: Path, dump: Path) -> None:
        self.case = case
        self._units = UNITS[case.units]
        self._steps = case.md_steps()
        self._energies_every = case.energies_every()
        self._window = 0
        self._seconds: dict[str, float] = {}
        self._external_work = self._interface_work = 0.0
        self._energies: dict[str, float] = {}
        self._finished = False  # with the present window
        self._tractions = rim_faces(case, ("traction",))
        self._drives = rim_faces(case, ("velocity", "symmetry"))

        self.engine = build(case, comm, log)
        self.name = f"lammps {self.engine.lammps.version()}"
        cutoff = self.engine.pair_cutoff()
        check_cutoff(case, cutoff, self.engine.is_pairwise())
        self.patch = own_patch(case.md_region(), case.md_patches(), comm)
        self._period = periods(case.background_grid())
        self._spacing = self._bulk_spacing()
        self._exchange = _scheme(case, self.engine, self._spacing, cutoff)
        self.offers, self.needs = self._exchange.offers, self._exchange.needs
        self._mark_parts(cutoff)
        self._relax()
        self._read_after()
        self._set_initial_state()
        self._set_forces()
        self._set_integration()
        self._set_output(dump)
        self._set_tally()
        self.engine.commands(["run 0 post no"])
        self._note_positions()
        self._fields = self._exchange.fields(0.0)

    # --- the coupling step -----------------------------------------------------------------

    def zone_fields(self) -> dict[str, Floats]:
        """Fields of the scheme on ``offers`` at the end of the last window."""
        return self._fields

    def advance(self, velocity: Floats) -> None:
        """Drive the boundary atoms with nodal velocities on ``needs`` over N steps.

        Raises
        ------
        BackendError
            LAMMPS stopped, or an atom left the grid or its patch.
        """
        self.finish()
        span = self.case.step()
        start = self._window * span
        with self._phase("drive"):
            self._drive(velocity, start, start + span)
            self._load(start, start + span)
            self._add_work_of_motion(0.5 * span)
        with self._phase("lammps"):
            self.engine.commands([f"run {self._steps} pre no post no"])
        with self._phase("project"):
            self._window += 1
            self._fields = self._exchange.fields(span)
            self._finished = False

    def finish(self) -> None:
        """Book the work of the window that ended now and tally energies, once."""
        if self._finished:
            return
        self._finished = True
        with self._phase("finish"):
            if self._window:
                span = self.case.step()
                end = self._window * span
                self._add_work_of_motion(0.5 * span)
                self._add_work_of_tractions(end - span, end)
                self._note_positions()
            self._energies = self._tally()

    def energies(self) -> dict[str, float]:
        """Energy, work, mass and momentum of this rank's atoms on its side of the interface.

        Nothing between the times at which energies are wanted.
        """
        self.finish()
        return self._energies

    def _tally(self) -> dict[str, float]:
        if self._window % self._energies_every:
            return {}
        engine = self.engine
        mass, momentum_x, momentum_y, twice_kinetic, potential = tally(
            engine.atoms("i_gimpmd_part"),
            CORE,
            engine.masses(),
            engine.pairs("v"),
            self._exchange.bonded,
            engine.stored("gimpmd_energy"),
            engine.atoms("d_gimpmd_pe0"),
        )
        return {
            "kinetic": self._units.energy_from_mechanical(0.5 * twice_kinetic),
            "potential": potential,
            "external_work": self._external_work,
            "interface_work": self._interface_work,
            "dissipated": self._exchange.dissipated(),
            "mass": mass,
            "momentum_x": momentum_x,
            "momentum_y": momentum_y,
        }

    def timings(self) -> dict[str, float]:
        """Wall seconds by phase since the last call."""
        seconds, self._seconds = self._seconds, {}
        return seconds

    def close(self) -> None:
        """Close LAMMPS and its files."""
        self.engine.close()

    # --- driving and work ------------------------------------------------------------------

    def _drive(self, velocity: Floats, start: float, end: float) -> None:
        """Set the velocities of boundary atoms and of driven faces for the window."""
        self._exchange.drive(velocity)
        v = self.engine.pairs("v")
        for face in self._drives:
            factor = face.mean_factor(start, end)
            for axis, value in enumerate(face.velocity()):
                if value is None:
                    continue
                layer = self._where(_bit(_LAYER, face))
                jump = (value * factor) ** 2 - v[layer, axis] ** 2
                v[layer, axis] = value * factor
                self._external_work += self._units.energy_from_mechanical(
                    0.5 * float((self.engine.masses(layer) * jump)[self._is_core(layer)].sum())
                )

    def _load(self, start: float, end: float) -> None:
        """Set the tractions' mean over the window as forces of the surface atoms.

        LAMMPS keeps them with the atoms. A force that is a LAMMPS variable would have it tally
        energy and stress of every atom at every step, at half the speed.
        """
        if not self._tractions:
            return
        forces = self.engine.external_forces("gimpmd_traction")
        forces[:] = 0.0
        for face in self._tractions:
            surface = self._where(_bit(_SURFACE, face))
            forces[surface, :2] += face.mean_factor(start, end) * self._atom_force[face.name]

    def _add_work_of_motion(self, span: float) -> None:
        """Work of prescribed motion over half a window, by the forces at one of its ends."""
        part, v = self.engine.atoms("i_gimpmd_part"), self.engine.pairs("v")
        self._interface_work -= span * power(part, BOUNDARY, v, self.engine.pairs("f"))
        if not self._drives:
            return
        true = self.engine.stored("gimpmd_force", 3)
        for axis in range(2):
            held = self._where(sum(self._drive_bits(axis)))
            held = held[self._is_core(held)]
            self._external_work -= span * float((v[held, axis] * true[held, axis]).sum())

    def _add_work_of_tractions(self, start: float, end: float) -> None:
        """Work along the way of the window that ended now."""
        x, last = self.engine.pairs("x"), self.engine.pairs("d2_gimpmd_last")
        for face in self._tractions:
            mean = face.mean_factor(start, end)
            surface = self._where(_bit(_SURFACE, face))
            surface = surface[self._is_core(surface)]
            path = np.empty((surface.size, 2))
            mean_velocity(x[surface], last[surface], self._period, 1.0, path)
            self._external_work += mean * float(
                (path.sum(axis=0) * self._atom_force[face.name]).sum()
            )

    def _note_positions(self) -> None:
        """Keep where the next window begins."""
        x, last = self.engine.pairs("x"), self.engine.pairs("d2_gimpmd_last")
        for axis in range(2):  # three times as fast as both at once
            last[:, axis] = x[:, axis]

    # --- set-up, in order ------------------------------------------------------------------

    def _bulk_spacing(self) -> float:
        """Distance of atoms in the bulk, ``sqrt(area per atom)``."""
        mass, atoms = self.engine.evaluate("mass(all)"), self.engine.lammps.get_natoms()
        spacing = float((mass / atoms / self.case.material().density) ** 0.5)
        cell = self.case.finest_cell()
        if spacing > cell:
            raise BackendError(
                f"the atoms are {spacing:g} apart, wider than grid.cell = {cell:g}; "
                "a cell must span at least one spacing"
            )
        return spacing

    def _mark_parts(self, cutoff: float) -> None:
        """Say of every atom, by its lattice position, what part it plays."""
        engine = self.engine
        engine.commands(
            [
                "fix gimpmd_atoms all property/atom i_gimpmd_part d_gimpmd_pe0 d2_gimpmd_lattice 2 "
                "d2_gimpmd_rest 2 d2_gimpmd_last 2",
                "run 0 post no",  # wraps and distributes the atoms
            ]
        )
        x = engine.pairs("x")
        engine.pairs("d2_gimpmd_lattice")[:] = x
        part = self._exchange.parts(x)
        free = (part & BOUNDARY) == 0
        self._atom_force: dict[str, Floats] = {}
        for face in self._tractions:
            surface = self._layer(face, x, 0.5 * self._spacing)
            count = engine.comm.allreduce(int(surface.sum()))
            self._atom_force[face.name] = np.array(face.force(self.case.units)) / count
            part |= np.where(surface & free, _bit(_SURFACE, face), 0)
        for face in self._drives:
            part |= np.where(self._layer(face, x, cutoff) & free, _bit(_LAYER, face), 0)
        engine.atoms("i_gimpmd_part")[:] = part
        self._group("gimpmd_boundary", [BOUNDARY])
        engine.commands(["group gimpmd_free subtract all gimpmd_boundary"])
        if engine.is_pairwise():
            # what driven atoms do to each other moves nothing: their pairs are left out
            engine.commands(["neigh_modify exclude group gimpmd_boundary gimpmd_boundary"])
        for axis, name in enumerate("xy"):
            self._group(f"gimpmd_driven_{name}", self._drive_bits(axis))
        self._group("gimpmd_surface", [_bit(_SURFACE, face) for face in self._tractions])

    def _relax(self) -> None:
        """Relax the free atoms; then note positions and energies at rest."""
        engine, every = self.engine, self._steps_between_tallies()
        engine.commands(
            [
                "compute gimpmd_pe all pe/atom",
                "compute gimpmd_xu all property/atom xu yu",
                "thermo_style custom step time temp ke",
                "thermo_modify norm no lost error",
                # LAMMPS moves the next output to the last step of a run, and tallies energy and
                # stress of every atom there, which takes as long as two steps; not so if a
                # variable says when it comes
                f"variable gimpmd_thermo equal (floor(step/{every})+1)*{every}",
                "thermo v_gimpmd_thermo",
                "fix gimpmd_plane all enforce2d",
            ]
        )
        if self.case.atoms.minimize:
            stiffness = float(self.case.stiffness()[0, 0]) / self._units.nktv2p
            tolerance = FORCE_TOLERANCE * stiffness * self._spacing
            engine.commands(
                [
                    "fix gimpmd_hold gimpmd_boundary setforce 0.0 0.0 0.0",
                    *self._hold_driven(),
                    "min_style cg",
                    "min_modify norm max",
                    f"minimize 0.0 {tolerance!r} 10000 100000",
                    "unfix gimpmd_hold",
                    *(f"unfix {name}" for name in self._driven_fixes()),
                ]
            )
        engine.commands(["reset_timestep 0", _tallying(1), "run 0 post no"])
        engine.pairs("d2_gimpmd_rest")[:] = engine.per_atom("gimpmd_xu", 2)
        engine.atoms("d_gimpmd_pe0")[:] = engine.stored("gimpmd_energy")
        engine.commands(["unfix gimpmd_energy"])

    def _read_after(self) -> None:
        after = self.case.atoms.after
        if after is not None:
            self.engine.script(after, {})
            refuse_integrators(after, self.engine)

    def _set_initial_state(self) -> None:
        u, v = self._exchange.initial_state()
        self.engine.pairs("x")[:] += u
        self.engine.pairs("v")[:] += v

    def _set_forces(self) -> None:
        """Tractions, then a copy of the true force, then driven components held."""
        commands = []
        if self._tractions:
            commands.append("fix gimpmd_traction gimpmd_surface external pf/array 1")
        if self._drives:
            commands += ["fix gimpmd_force all store/force", *self._hold_driven()]
        self.engine.commands(commands)

    def _set_integration(self) -> None:
        self.engine.commands(
            [
                f"timestep {self.case.md_timestep()!r}",
                "run_style verlet",
                "fix gimpmd_free gimpmd_free nve",
                "fix gimpmd_boundary gimpmd_boundary nve/noforce",
                "unfix gimpmd_plane",  # the last fix must be the one that keeps the plane
            ]
        )
        if not self._is_flat():
            self.engine.commands(["fix gimpmd_plane all enforce2d"])

    def _is_flat(self) -> bool:
        """Whether atoms stay in the plane by themselves: nothing ever pushes them out of it.

        Interatomic forces lie in the plane of the atoms; fixes of the user's may not. Keeping the
        plane by a fix costs 3 % of LAMMPS's time.
        """
        z, vz = (self.engine.atoms(name).reshape(-1, 3)[:, 2] for name in "xv")
        bounds = np.array([[z.min(initial=np.inf)], [z.max(initial=-np.inf)]])
        low, high = extent(self.engine.comm, bounds)
        moving = self.engine.comm.allreduce(int(np.count_nonzero(vz)))
        own = all(name.startswith("gimpmd_") for name in self.engine.fixes())
        return own and not moving and bool(low[0] == high[0])

    def _set_output(self, dump: Path) -> None:
        """Dump positions, displacements from rest, and stress times area of every atom."""
        every = self.case.output_every() * self._steps
        columns = {
            "v_gimpmd_ux": "ux",
            "v_gimpmd_uy": "uy",
            "d2_gimpmd_lattice[1]": "X0",
            "d2_gimpmd_lattice[2]": "Y0",
            "c_gimpmd_stress[1]": "sxx_area",
            "c_gimpmd_stress[2]": "syy_area",
            "c_gimpmd_stress[4]": "sxy_area",
        }
        names = " ".join(f"colname {column} {name}" for column, name in columns.items())
        self.engine.commands(
            [
                "compute gimpmd_stress all stress/atom NULL virial",
                'variable gimpmd_ux atom "c_gimpmd_xu[1]-d2_gimpmd_rest[1]"',
                'variable gimpmd_uy atom "c_gimpmd_xu[2]-d2_gimpmd_rest[2]"',
                f"dump gimpmd all custom {every} {dump} id type x y z vx vy {' '.join(columns)}",
                f"dump_modify gimpmd sort id format float %.9g {names}",
            ]
        )

    def _set_tally(self) -> None:
        """Let LAMMPS tally energies of atoms at the times alone at which they are wanted.

        Raises
        ------
        BackendError
            Steps are no longer counted from 0.
        """
        step = self.engine.lammps.extract_global("ntimestep")
        if step:
            raise BackendError(
                f"{self.case.atoms.after}: LAMMPS stands at step {step}, not 0, after it; "
                "end the script with reset_timestep 0"
            )
        self.engine.commands([_tallying(self._steps_between_tallies())])

    def _steps_between_tallies(self) -> int:
        """MD steps between the times at which energies are wanted."""
        return self._energies_every * self._steps

    # --- parts ------------------------------------------------------------------------------

    def _where(self, bits: int) -> Ints:
        """Places of the local atoms that have one of the bits."""
        return np.flatnonzero(self.engine.atoms("i_gimpmd_part") & np.int32(bits))

    def _is_core(self, places: Ints) -> Bools:
        """Which of the atoms count in the energy, and so in the work."""
        core: Bools = (self.engine.atoms("i_gimpmd_part")[places] & np.int32(CORE)) != 0
        return core

    def _drive_bits(self, axis: int) -> list[int]:
        return [_bit(_LAYER, face) for face in self._drives if face.velocity()[axis] is not None]

    def _hold_driven(self) -> list[str]:
        """Commands that take the force off driven components."""
        forces = {"x": "0.0 NULL NULL", "y": "NULL 0.0 NULL"}
        return [f"fix {name} {name} setforce {forces[name[-1]]}" for name in self._driven_fixes()]

    def _driven_fixes(self) -> list[str]:
        return [f"gimpmd_driven_{name}" for axis, name in enumerate("xy") if self._drive_bits(axis)]

    def _layer(self, face: RimFace, x: Floats, depth: float) -> Bools:
        """Atoms within ``depth`` of the outermost atoms of a face."""
        outermost = face.outermost(x)
        low, high = extent(self.engine.comm, np.array([[outermost], [outermost]]))
        away = high[0] - x[:, face.axis] if face.side else x[:, face.axis] - low[0]
        layer: Bools = away < depth
        return layer

    def _group(self, name: str, bits: list[int]) -> None:
        """Make a LAMMPS group of the atoms that have one of the bits."""
        formula = "+".join(f"(floor(i_gimpmd_part/{bit})%2)" for bit in bits) or "0.0"
        self.engine.commands(
            [
                f'variable gimpmd_member atom "{formula}"',
                f"group {name} variable gimpmd_member",
                "variable gimpmd_member delete",
            ]
        )

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        """Add the wall time of a block to a phase."""
        start = time.perf_counter()
        yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - start


def _tallying(every: int) -> str:
    """A command that has LAMMPS keep the energy of every atom, at every so many steps.

    LAMMPS's own output would ask for energies at the end of every window, and a step that tallies
    them takes about twice as long as others.
    """
    return f"fix gimpmd_energy all ave/atom {every} 1 {every} c_gimpmd_pe"


def _bit(first: int, face: RimFace) -> int:
    return first << (2 * face.axis + face.side)


def _scheme(case: Case, engine: Engine, spacing: float, cutoff: float) -> Exchange:
    """The scheme of the case."""
    if case.coupling.scheme == "force":
        return ForceExchange(case, engine, cutoff)
    return VelocityExchange(case, engine, spacing)
