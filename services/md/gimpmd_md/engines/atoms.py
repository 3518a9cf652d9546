"""The atoms of one rank: all that gimpmd asks of an MD code.

`side.MdSide` does everything else, from the loads to the energies, with these arrays. A new MD code
is a class with this interface, and an entry point that names it (`gimpmd_schemas.registry`)::

    [project.entry-points."gimpmd.md"]
    mycode = "mypackage.atoms:MyAtoms"
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Spring:
    """Springs that hold the atoms with a role bit at their positions at rest, along one axis.

    The force on an atom is ``-stiffness`` times its displacement along the axis. It does not count
    in the potential energy.

    Attributes
    ----------
    bit : int
    axis : int
    stiffness : float
        Force per length.
    """

    bit: int
    axis: int
    stiffness: float


class Atoms(Protocol):
    """The atoms of one patch in an MD code, in d dimensions.

    Every array has one row for each atom of this rank. All arrays are in the same order of atoms,
    which may change during `settle`, `start` and `run`, when atoms move to other ranks. An array is
    valid until the next call of one of these methods. Quantities are in units of the unit style.

    The side calls the methods in this order: the constructor, `settle`, `start`, then `run` once
    for each coupling step, and `close`. In a run that goes on from a checkpoint, `restore` comes
    after `start`.

    Attributes
    ----------
    comm : mpi4py communicator
        One rank for each patch of ``plan.atoms.patches``.
    cutoff : float
        Range of the potential (length).
    pairwise : bool
        Whether the potential is a sum over pairs of atoms. If not, the force on an atom depends on
        atoms up to two cutoffs away.
    x, v : ndarray, shape ``(n, d)``, writable
        Positions and velocities. Positions may be wrapped at periodic faces.
    f : ndarray, shape ``(n, d)``, writable
        Forces on the atoms by all other atoms, by springs and by `external`.
    mass : ndarray, shape ``(n,)``
        Masses.
    role : ndarray of int32, shape ``(n,)``, writable
        Role of each atom (`roles`); the side writes it before `settle`. It travels with the atom.
    site : ndarray, shape ``(n, d)``
        Lattice positions: where the constructor put the atoms. They travel with the atoms.
    rest : ndarray, shape ``(n, d)``
        Positions at rest, not wrapped at periodic faces: where `settle` left the atoms. They travel
        with the atoms.
    last : ndarray, shape ``(n, d)``, writable
        Values that the side keeps with the atoms: the positions at the start of a coupling step,
        of those atoms for which it needs them.
    preload : ndarray, shape ``(n, d)``, writable
        Values that the side keeps with the atoms, zero at first: constant forces that act in place
        of the atoms outside a face with a prescribed motion.
    external : ndarray, shape ``(n, d)``, writable
        Forces on the atoms that have one of the bits ``loaded`` of `settle`. They stay the same
        during `run`, are added to the forces of the potential and travel with the atoms.
    potential : ndarray, shape ``(n,)``
        Potential energy of each atom, minus that at rest. Valid at every
        ``plan.energies_every`` th coupling step, step 0 included.
    migrations : int
        Changes whenever atoms may have moved to other ranks or changed their order; the same number
        on all ranks.
    fix_work : float
        Work that the user's own additions to the MD code, such as a thermostat or an indenter, have
        done on the atoms of this rank since `start` (energy units); 0 if there are none. Only
        atoms with one of the bits ``counted`` of `settle` count.
    notes : tuple of str
        What the user must know about the results, one sentence each, without a full stop; complete
        after `start`.
    """

    comm: Any
    cutoff: float
    pairwise: bool
    migrations: int
    notes: tuple[str, ...]

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        """Make the atoms at their lattice positions.

        Parameters
        ----------
        plan : Plan
        comm : mpi4py communicator
        run_dir : Path
            Folder of the run, relative to the working directory, which holds the input files.
            Output goes to ``atoms/`` and ``logs/`` in the folder of the run.

        Raises
        ------
        BackendError
            The code is not installed, or it refuses the input.
        """

    @staticmethod
    def version() -> str:
        """Name and version of the code, for the records of the run."""
        ...

    @property
    def x(self) -> Floats:
        """Positions."""
        ...

    @property
    def v(self) -> Floats:
        """Velocities."""
        ...

    @property
    def f(self) -> Floats:
        """Forces."""
        ...

    @property
    def mass(self) -> Floats:
        """Masses."""
        ...

    @property
    def role(self) -> Ints:
        """Role bits."""
        ...

    @property
    def site(self) -> Floats:
        """Lattice positions."""
        ...

    @property
    def rest(self) -> Floats:
        """Positions at rest."""
        ...

    @property
    def last(self) -> Floats:
        """Positions at the start of the coupling step."""
        ...

    @property
    def preload(self) -> Floats:
        """Constant forces near faces with a prescribed motion."""
        ...

    @property
    def external(self) -> Floats:
        """External forces."""
        ...

    @property
    def potential(self) -> Floats:
        """Potential energies above those at rest."""
        ...

    @property
    def fix_work(self) -> float:
        """Work of the user's additions."""
        ...

    def settle(
        self,
        springs: Sequence[Spring],
        loaded: int,
        counted: int,
        tolerance: float | None,
        saved: SavedStates | None = None,
    ) -> None:
        """Take the roles, relax the atoms, and note positions and energies at rest.

        From here on atoms with the role ``BOUNDARY`` keep all components of their velocity. If the
        potential is a sum over pairs, forces and energies of pairs of such atoms are left out: the
        force scheme takes `f` of these atoms as the force of the free atoms on them.

        Parameters
        ----------
        springs : sequence of Spring
            From the end of this method on they hold atoms at their positions at rest.
        loaded : int
            Role bits of the atoms on which `external` acts.
        counted : int
            Role bits of the atoms on which `fix_work` counts.
        tolerance : float or None
            The atoms are relaxed without the springs until no force component is larger (force).
            None: the atoms are not relaxed.
        saved : SavedStates, optional
            The checkpoint from which the run goes on. The code counts its steps from there, and
            may take the positions at rest from it in place of relaxing the atoms.

        On return `f` belongs to the positions at rest.
        """

    def start(self) -> None:
        """Get ready to run, after the side has set `x` and `v` of the initial state.

        On return `f` and `potential` belong to these positions.
        """

    def run(self, steps: int) -> None:
        """Take MD steps of ``plan.atoms.timestep`` with no Python inside.

        Parameters
        ----------
        steps : int

        Raises
        ------
        BackendError
            The code stopped.
        """

    def renew(self) -> None:
        """Compute everything that `state` does not hold from what it holds.

        Neighbour lists and forces are made anew, with the atoms of a rank in an order that follows
        from their positions. So a run that goes on from the state has the same bits as this one.
        """

    def state(self) -> Mapping[str, Array]:
        """All that this rank needs to go on, after `renew`, by names of its own.

        Names that begin with ``total/`` are amounts that add up over the ranks. Names that begin
        with ``side/`` belong to the side.
        """
        ...

    def restore(self, saved: SavedStates) -> None:
        """Set the atoms to a saved state, `renew` them, and go on with the output from there.

        The states of the ranks may have been saved by another number of ranks.

        Raises
        ------
        BackendError
            The saved atoms are not those of this run.
        """

    def close(self) -> None:
        """Close the code and its files."""
