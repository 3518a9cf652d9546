"""Short waves near the planes: motion that the grid cannot carry on, so that the planes reflect it.

The nodes see of the atoms near the planes the mean velocity ``V = M^-1 S^T m v`` (S: linear shape
functions at lattice positions, M: lumped nodal mass). Of a wave along an axis they leave out the
share ``(1 - sinc(k h / 2)^4)^2`` of its energy, up to what else of it they see as longer waves: 1 %
at a wavelength of 8 cells, 11 % at 4 cells, 28 % at 3 cells, and half or more at 2 cells, the
shortest wave that a grid has.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from gimpmd_md.coupling.shape_functions import Stencils
from gimpmd_md.coupling.site_stencils import SiteStencils
from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import CORE, PROJECTED, WATCHED
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding, check
from gimpmd_schemas.wire.plausibility import strain_energy

SHARE = 0.3
"""Largest share of short waves in the kinetic energy near the planes: a wavelength of 3 cells."""

LEAST_ENERGY = 0.01
"""Least energy of short waves that counts, over the largest kinetic energy of the atoms so far."""

LEAST_STRAIN = 1e-4
"""Strain of the atoms near the planes whose energy is the least that counts, too: a relaxed crystal
still moves a little."""


class ShortWaves:
    """Short waves of the free atoms near the planes, in a run by the force scheme.

    Heat is motion in short waves too. Where the atoms are warm from the start, that is where they
    move otherwise than by ``initial``, or where fixes have done more work than the short waves have
    energy, the case explains them.

    Parameters
    ----------
    plan : Plan
        Of a run by the force scheme without an absorber.
    atoms : Atoms
    """

    def __init__(self, plan: Plan, atoms: Atoms) -> None:
        grid = plan.background_grid()
        self._plan, self._atoms = plan, atoms
        self._units, self._cell = UNITS[plan.units], grid.cell
        self._band = SiteStencils(plan, atoms, PROJECTED, np.flatnonzero(grid.canonical()))
        self._strain_energy = partial(strain_energy, plan)
        self._largest = 0.0  # kinetic energy of the atoms
        self._warm: bool | None = None
        # what follows from the atoms on this rank, and the stencils for which it holds
        self._prepared: tuple[tuple[Ints, Stencils], Floats, Floats, Bools] | None = None

    @property
    def margin(self) -> float:
        """Width (length) of the band behind the watched atoms whose motion the nodes need."""
        return self._cell

    def look(self, side: Energies) -> tuple[Finding, ...]:
        """Compare the energy of short waves with that of all motion near the planes; collective.

        Parameters
        ----------
        side : Energies
            Of all atoms, now.
        """
        self._largest = max(self._largest, side.kinetic)
        if self._warm is None:
            heat = self._atoms.v - initial_state(self._plan, self._atoms.rest)[1]
            short, _, mass = self._energies(heat)
            self._warm = short > self._least(mass)
        short, whole, mass = self._energies(self._atoms.v)
        if self._warm or short <= max(self._least(mass), abs(side.fix_work)):
            return ()
        return check("short waves", short / whole, SHARE)

    def state(self) -> Floats:
        """What a run that goes on needs, shape ``(2,)``."""
        return np.array([self._largest, np.nan if self._warm is None else self._warm])

    def restore(self, state: Floats) -> None:
        """Go on from a `state`."""
        self._largest = float(state[0])
        self._warm = None if np.isnan(state[1]) else bool(state[1])

    def _least(self, mass: float) -> float:
        """Energy up to which short waves near the planes do not count."""
        return max(LEAST_ENERGY * self._largest, self._strain_energy(mass, LEAST_STRAIN))

    def _energies(self, v: Floats) -> tuple[float, float, float]:
        """Kinetic energy of short waves and of all motion, and mass, of the watched free atoms.

        Parameters
        ----------
        v : ndarray, shape ``(n, d)``
            Velocities of the atoms of this rank.
        """
        found = self._band.find()
        if self._prepared is None or self._prepared[0] is not found:
            self._prepared = found, *self._prepare(*found)
        (rows, stencils), m, mass, counted = self._prepared
        v = v[rows]
        nodal = np.divide(self._band.sums(stencils, m * v), mass)
        v, unseen, m = v[counted], (v - stencils.interpolate(nodal))[counted], m[counted, 0]
        own = np.array([_square(m, unseen), _square(m, v), m.sum()])
        short, whole, of_band = self._atoms.comm.allreduce(own).tolist()
        unit = self._units.energy_from_mechanical(0.5)
        return unit * short, unit * whole, of_band

    def _prepare(self, rows: Ints, stencils: Stencils) -> tuple[Floats, Floats, Bools]:
        """Masses of the atoms and of the nodes, inf where it is zero, and which atoms count."""
        m, role = self._atoms.mass[rows][:, None], self._atoms.role[rows]
        mass = self._band.sums(stencils, np.repeat(m, self._plan.dim, axis=1))
        mass[mass <= 0.0] = np.inf
        counted: Bools = (role & np.int32(CORE | WATCHED)) == (CORE | WATCHED)
        return m, mass, counted


def _square(m: Floats, v: Floats) -> float:
    return float(np.einsum("a,ai,ai", m, v, v))
