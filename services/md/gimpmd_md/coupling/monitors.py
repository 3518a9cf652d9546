"""The monitors of the atoms' side, together: what makes the results of the atoms untrustworthy."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from gimpmd_md.coupling.bond_watch import BondWatch
from gimpmd_md.coupling.short_waves import ShortWaves
from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import PROJECTED
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.wire.energies import Energies, total
from gimpmd_schemas.wire.findings import Finding, check
from gimpmd_schemas.wire.plausibility import INITIAL_STRAIN, Plausibility, strain_energy

SUMS, COUNT, SHORT_WAVES = "monitors/sums", "monitors/count", "monitors/short_waves"


class Monitors:
    """Monitors of the atoms of one rank; they look at the steps with energies.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
        As the script of ``md.input`` made them.
    """

    def __init__(self, plan: Plan, atoms: Atoms) -> None:
        self._plan, self._atoms = plan, atoms
        self._plausibility = Plausibility(plan)
        self._bonds = BondWatch(plan, atoms) if plan.coupling else None
        coupling = plan.coupling
        seen = coupling is not None and coupling.scheme == "force" and coupling.absorber is None
        self._short_waves = ShortWaves(plan, atoms) if seen else None
        self._count = atoms.comm.allreduce(len(atoms.mass))

    def roles(self) -> Ints:
        """Role bits by lattice position, shape ``(n,)``."""
        if self._bonds is None:
            return np.zeros(len(self._atoms.site), dtype=np.int64)
        role = self._bonds.roles()
        if self._short_waves is not None:
            role |= np.where(self._bonds.near(self._short_waves.margin), PROJECTED, 0)
        return role

    def look(self, step: int, energies: Energies) -> tuple[Finding, ...]:
        """Look at the atoms; collective.

        Parameters
        ----------
        step : int
            Coupling step.
        energies : Energies
            Of the atoms of this rank at this step.

        Returns
        -------
        tuple of Finding
            Findings about single bonds come from the rank that has the bond, all others from the
            first one.
        """
        atoms = self._atoms
        ranks = atoms.comm.allgather((energies, len(atoms.mass)))
        side = total([energies for energies, _ in ranks])
        if side is None:
            raise ValueError("a rank has no energies at this step")
        change = abs(sum(count for _, count in ranks) - self._count)
        whole = (*check("atoms", float(change), 0.0), *self._plausibility.look(side))
        if step == 0:
            whole += self._initial(side)
        if self._short_waves is not None:
            whole += self._short_waves.look(side)
        own = self._bonds.look() if self._bonds else ()
        return own + whole if atoms.comm.rank == 0 else own

    def state(self) -> dict[str, Floats]:
        """What a run that goes on needs; the same on all ranks."""
        state = {SUMS: self._plausibility.state(), COUNT: np.array(float(self._count))}
        if self._short_waves is not None:
            state[SHORT_WAVES] = self._short_waves.state()
        return state

    def restore(self, state: Mapping[str, Floats]) -> None:
        """Go on from the `state` of any rank."""
        self._plausibility.restore(state[SUMS])
        self._count = int(state[COUNT])
        if self._short_waves is not None:
            self._short_waves.restore(state[SHORT_WAVES])

    def _initial(self, side: Energies) -> tuple[Finding, ...]:
        """Compare the potential energy at the start with that of the initial state; collective."""
        gradient = initial_state(self._plan, self._atoms.rest)[2]
        squares = (gradient**2).sum(axis=(1, 2))
        strain = max(self._atoms.comm.allgather(float(squares.max(initial=0.0)))) ** 0.5
        energy = partial(strain_energy, self._plan, side.mass)
        most = energy(INITIAL_STRAIN) + energy(strain)
        return check("initial energy", abs(side.potential) / most if most > 0.0 else 0.0, 1.0)
