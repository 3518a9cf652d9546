"""Damping of waves that the grid cannot carry, and the random force that balances it.

Phonons much shorter than a few cells cannot go on in the grid, so the planes reflect them. Free
atoms in a band along the planes lose the part of their motion that the grid does not see,

    v' = v + n - A (v + n / 4),    A = g dt R D R,    n = sqrt(2 g dt k T / m) R D^(1/2) xi.

Here g is the rate, dt the coupling step, k T the thermal energy and m the mass of an atom.
R = (I - S M^-1 S^T m)^3 removes what the nodes carry (S: linear shape functions, M: lumped nodal
mass). D is one at the planes and falls to zero at the inner end of the band. xi are standard normal
numbers, one for each component. R is symmetric with respect to the masses and maps a uniform motion
to zero. So momentum is conserved, and at T = 0 energy never grows. The random force balances the
damping at the temperature T (fluctuation and dissipation); the factor 1/4 makes this hold to second
order in g dt. xi depend on lattice site and step only, so the number of patches does not matter.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.noise import normals
from gimpmd_md.coupling.shape_functions import Stencils
from gimpmd_md.coupling.site_stencils import SiteStencils
from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import PROJECTED
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Absorber as Settings
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.units import UNITS

CORRECTIONS = 3
"""How often the motion that the nodes carry is removed: the power of R.

A wave of eight cells that comes back from held ghosts keeps a share 0.885, 0.975, 0.990 or 0.995 of
its energy with one, two, three or six corrections, at g = 2 in reduced units. Many corrections tend
to the least-squares fit.
"""

SITES_PER_CELL = 4096
"""Resolution, in parts of a cell, of the lattice positions for which random numbers are drawn.

A power of two, so that positions at simple fractions of a cell are far from the edge between two
sites. Round-off, which may depend on the patches, cannot move them across it.
"""


class Absorber:
    """The band along the planes of one patch.

    Parameters
    ----------
    plan : Plan
        Of a run by the force scheme.
    settings : Settings
        ``coupling.absorber``, with its width known.
    atoms : Atoms

    Attributes
    ----------
    dissipated : float
        Energy that the absorber has taken out of the atoms of this rank since the start (energy
        units). It is negative if the random force has added more.
    """

    def __init__(self, plan: Plan, settings: Settings, atoms: Atoms) -> None:
        grid = plan.background_grid()
        self._atoms, self._interfaces = atoms, plan.coupled.interfaces
        self._width = _width(settings)
        self._strength = settings.rate * plan.step  # g dt
        self._seed, self._step = settings.seed, 0
        self._units = UNITS[plan.units]
        self._heat = self._units.energy_to_mechanical(settings.temperature * self._units.boltz)
        self._band = SiteStencils(plan, atoms, PROJECTED, self._nodes(grid))
        self._origin, self._pitch = np.array(grid.origin), grid.cell / SITES_PER_CELL
        self.dissipated = 0.0

    def contains(self, x: Floats) -> Bools:
        """Which atoms, by lattice position, are in the band."""
        depth = self._depth(x)
        inside: Bools = (depth > 0.0) & (self._ramp(x) > 0.0)
        return inside

    def apply(self) -> None:
        """Change the velocities of the band for one coupling step; collective."""
        atoms = self._atoms
        rows, stencils = self._band.find()
        x, m = atoms.site[rows], atoms.mass[rows][:, None]
        ramp = self._ramp(x)[:, None]
        mass = self._band.sums(stencils, np.repeat(m, x.shape[1], axis=1))
        v = atoms.v[rows]
        new = v.copy()
        if self._heat > 0.0:
            # ids of atoms depend on the patches, lattice positions do not
            sites = np.rint((x - self._origin) / self._pitch).astype(np.int64)
            size = np.sqrt(2.0 * self._strength * self._heat * ramp / m)
            noise = size * normals(self._seed, self._step, sites)
            new += self._unseen(stencils, mass, m, noise)
        self._step += 1
        damped = ramp * self._unseen(stencils, mass, m, 0.75 * v + 0.25 * new)
        new -= self._strength * self._unseen(stencils, mass, m, damped)
        atoms.v[rows] = new
        lost = 0.5 * float((m * (v * v - new * new)).sum())
        self.dissipated += self._units.energy_from_mechanical(lost)

    def go_on(self, step: int, dissipated: float) -> None:
        """Go on from a coupling step at which so much energy had been taken out.

        The random numbers depend on site and step alone, so nothing else is needed.
        """
        self._step, self.dissipated = step, dissipated

    def _unseen(self, stencils: Stencils, mass: Floats, m: Floats, v: Floats) -> Floats:
        """The part of velocities that the nodes do not carry, ``R v``."""
        for _ in range(CORRECTIONS):
            nodal = self._band.sums(stencils, m * v)
            np.divide(nodal, mass, out=nodal, where=mass > 0.0)
            v = v - stencils.interpolate(nodal)
        return v

    def _ramp(self, x: Floats) -> Floats:
        """D: one in the third of the band next to the planes, then linear to zero inward."""
        return np.clip(1.5 * (1.0 - self._depth(x) / self._width), 0.0, 1.0)

    def _depth(self, x: Floats) -> Floats:
        """Depth below the planes, negative among the ghosts."""
        deepest: Floats = np.max([interface.depth(x) for interface in self._interfaces], axis=0)
        return deepest

    def _nodes(self, grid: BackgroundGrid) -> Ints:
        """Canonical nodes that atoms of the band may touch."""
        x, h = grid.positions(), grid.cell
        touched = np.zeros(grid.size, dtype=np.bool_)
        for interface in self._interfaces:
            near, deep = grid.canonical(), np.ones(grid.size, dtype=np.bool_)
            for axis, ((low, high), (start, end)) in enumerate(
                zip(interface.planes, interface.core(), strict=True)
            ):
                near &= (x[:, axis] > start - h) & (x[:, axis] < end + h)
                margin = self._width + h
                deep &= (x[:, axis] > low + margin) & (x[:, axis] < high - margin)
            touched |= near & ~deep
        return np.flatnonzero(touched).astype(np.int64)


def _width(settings: Settings) -> float:
    """Width of the band.

    Raises
    ------
    ValueError
        The width is not known: the settings are not those of a plan.
    """
    if settings.width is None:
        raise ValueError("the width of the absorber has not been chosen")
    return settings.width
