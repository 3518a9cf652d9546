"""Damping, near the planes, of what the grid cannot carry, and the random force that goes with it.

Phonons much shorter than a few cells find no grid mode to go on with and come back from the planes.
Free atoms in a band there lose the part of their motion that the grid does not see,

    v' = v + n - A (v + n / 4),    A = g dt R D R,    n = sqrt(2 g dt k T / m) R D^(1/2) xi,

where R = (I - S M^-1 S^T m)^3 takes off what nodes carry (S linear hats, M lumped mass), D ramps
from zero at the band's inner end to one at the planes, and xi are standard normal numbers. R is
symmetric in the metric of the masses and makes nothing of a uniform motion: momentum is kept, and
at T = 0 energy never grows. The random force balances the damping at the temperature T (fluctuation
and dissipation); the quarter makes that hold to second order in g dt. xi belong to lattice site and
step, so patches change nothing.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.halo import Halo
from gimpmd_md.coupling.noise import normals
from gimpmd_md.coupling.scheme import PROJECTED
from gimpmd_md.coupling.shape_functions import ShapeFunctions, Stencils
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Absorber as Settings
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.mechanics.units import UNITS

CORRECTIONS = 3
"""How often what nodes carry is taken off.

Of a wave of eight cells that comes back from held ghosts, once, twice, three times and six times
leave 0.885, 0.975, 0.990, 0.995 at g = 2 lj; many times tend to the least-squares fit.
"""

WIDTH_CELLS = 4.0
"""Width of the band where the case gives none."""

SITES_PER_CELL = 4096
"""Lattice positions are told apart to this part of a cell when random numbers are drawn for them.

A power of two: positions that are simple fractions of a cell then lie far from where round-off,
which may depend on the patches, could move them to the next site.
"""


class Absorber:
    """The band along the planes of one patch.

    Parameters
    ----------
    case : Case
    settings : Settings
        ``coupling.absorber`` of the case.
    engine : Engine
    interfaces : tuple of Interface
        Of each MD region.

    Attributes
    ----------
    dissipated : float
        Energy taken out of the atoms of this rank since the start (energy units); less than zero
        where the random force has given more.
    """

    def __init__(
        self, case: Case, settings: Settings, engine: Engine, interfaces: tuple[Interface, ...]
    ) -> None:
        grid = case.background_grid()
        self._engine, self._interfaces = engine, interfaces
        self._width = WIDTH_CELLS * grid.cell if settings.width is None else settings.width
        self._strength = settings.rate * case.step()  # g dt
        self._seed, self._window = settings.seed, 0
        self._units = UNITS[case.units]
        boltzmann = float(engine.lammps.extract_global("boltz"))
        self._heat = settings.temperature * boltzmann / self._units.mvv2e  # k T, mechanical
        self._halo = Halo(engine.comm, grid, case.md_region(), case.md_patches(), self._nodes(grid))
        self._origin, self._pitch = np.array(grid.origin), grid.cell / SITES_PER_CELL
        self._hats = ShapeFunctions(grid, self._halo.nodes)
        self._halo.connect(self._hats.rows, width=2)
        self.dissipated = 0.0

    def contains(self, x: Floats) -> Bools:
        """Which atoms, by lattice position, are in the band."""
        depth = self._depth(x)
        inside: Bools = (depth > 0.0) & (self._ramp(x) > 0.0)
        return inside

    def apply(self) -> None:
        """Change the velocities of the band for one coupling step; collective among neighbours."""
        engine = self._engine
        places = np.flatnonzero(engine.atoms("i_gimpmd_part") & np.int32(PROJECTED))
        x, m = engine.pairs("d2_gimpmd_lattice")[places], engine.masses(places)[:, None]
        hats, ramp = self._hats.stencils(x), self._ramp(x)[:, None]
        mass = self._gathered(hats, np.repeat(m, 2, axis=1))
        v = engine.pairs("v")[places]
        new = v.copy()
        if self._heat > 0.0:
            # ids of atoms depend on the patches, lattice positions do not
            sites = np.rint((x - self._origin) / self._pitch).astype(np.int64)
            size = np.sqrt(2.0 * self._strength * self._heat * ramp / m)
            noise = size * normals(self._seed, self._window, sites)
            new += self._unseen(hats, mass, m, noise)
        self._window += 1
        damped = ramp * self._unseen(hats, mass, m, 0.75 * v + 0.25 * new)
        new -= self._strength * self._unseen(hats, mass, m, damped)
        engine.pairs("v")[places] = new
        lost = 0.5 * float((m * (v * v - new * new)).sum())
        self.dissipated += self._units.energy_from_mechanical(lost)

    def _unseen(self, hats: Stencils, mass: Floats, m: Floats, v: Floats) -> Floats:
        """What is left of velocities without what nodes carry, ``R v``."""
        for _ in range(CORRECTIONS):
            nodal = self._gathered(hats, m * v)
            np.divide(nodal, mass, out=nodal, where=mass > 0.0)
            v = v - hats.interpolate(nodal)
        return v

    def _gathered(self, hats: Stencils, values: Floats) -> Floats:
        """Nodal sums of values of the band's atoms, over all patches."""
        sums = hats.gather(values, self._halo.nodes.size)
        self._halo.complete(sums)
        return sums

    def _ramp(self, x: Floats) -> Floats:
        """D: one within a third of the band from the planes, down to zero at its inner end."""
        return np.clip(1.5 * (1.0 - self._depth(x) / self._width), 0.0, 1.0)

    def _depth(self, x: Floats) -> Floats:
        """Depth below the planes, negative among the ghosts."""
        deepest = np.full(len(x), -np.inf)
        for interface in self._interfaces:
            depth = np.full(len(x), np.inf)
            for axis, (low, high) in enumerate(interface.planes):
                depth = np.minimum(depth, np.minimum(x[:, axis] - low, high - x[:, axis]))
            deepest = np.maximum(deepest, depth)
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
