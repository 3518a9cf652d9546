"""Damping of waves that are too short for the grid, and the random force that balances it.

The grid carries waves down to a length of 3.85 cells. Shorter ones come back from the planes. So
free atoms in a band along the planes lose the part of their motion that a smooth fit leaves over,

    v' = v + w - A (v + w / 4),   A = g dt m^-1 R^T m D R,   w = m^-1 R^T sqrt(2 g dt k T m D) xi.

Here g is the rate, dt the coupling step, k T the thermal energy, m the mass of a particle, and R
what the fit of `spline_fit` leaves of velocities. D is one at the planes and falls to zero at the
inner end of the band, as ``1 - 3 q^2 + 2 q^3``. xi are standard normal numbers, one for each
component.

The fit also sees three columns of nodes outside the planes, with the mass of their part of the
body and D = 0. So it knows the motion on both sides of the planes, and leaves waves alone that
cross them. The nodes have their share of the force.

``m A`` is symmetric and not negative, so at T = 0 energy never grows. Linear velocity fields are
left alone, and forces have no resultant and no moment. The random force balances the damping at
the temperature T (fluctuation and dissipation); the factor 1/4 makes this hold to second order in
g dt. xi depend on lattice site and step only, so the number of patches does not matter.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.noise import normals
from gimpmd_md.coupling.spline_fit import SplineFit
from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import PROJECTED
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Absorber as Settings
from gimpmd_schemas.case.interface_nodes import fit_nodes
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import deepest
from gimpmd_schemas.mechanics.units import UNITS

FIT_BEHIND = 2.5
"""How far the atoms that the fit sees reach behind the band, in cells."""

LARGEST_STRENGTH = 0.4
"""Largest g dt of one application with a random force, whose error is of second order in it."""

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
        Of a run by a scheme with planes.
    settings : Settings
        ``coupling.absorber``, with rate and width known.
    atoms : Atoms
        At their lattice positions.
    own : ndarray of int64
        Ids of nodes that belong to this rank and no other.

    Attributes
    ----------
    nodes : ndarray of int64, shape ``(m,)``
        Ids, ascending, of those among them that the fit sees.
    impulse : ndarray, shape ``(m, d)``
        On these nodes, by the last application (mass length / time).
    dissipated : float
        Energy that the absorber has taken out of the atoms and nodes of this rank since the start
        (energy units). It is negative if the random force has added more.
    from_nodes : float
        The part of it that came from the nodes: the work that nodes have done on the absorber.
    """

    def __init__(self, plan: Plan, settings: Settings, atoms: Atoms, own: Ints) -> None:
        grid = plan.background_grid()
        self._atoms, self._interfaces = atoms, plan.coupled.interfaces
        self._rate, self._width = _known(settings)
        self._strength = self._rate * plan.step  # g dt
        self._reach = self._width + FIT_BEHIND * grid.cell
        self._seed, self._step = settings.seed, 0
        self._units = UNITS[plan.units]
        self._heat = self._units.energy_to_mechanical(settings.temperature * self._units.boltz)
        self._origin, self._pitch = np.array(grid.origin), grid.cell / SITES_PER_CELL
        seen = fit_nodes(plan)
        self.nodes = np.intersect1d(seen, own)
        x, mass = grid.positions(), plan.continuum.material.density * _volumes(grid)
        self._node_x, self._node_mass = x[self.nodes], mass[self.nodes]
        inside = self.contains(atoms.site)
        of_atoms = atoms.comm.allgather((atoms.site[inside], atoms.mass[inside]))
        all_x, all_mass = (np.concatenate(each) for each in zip(*of_atoms, strict=True))
        self._fit = SplineFit(
            grid,
            np.concatenate([all_x, x[seen]]),
            np.concatenate([all_mass, mass[seen]]),
            atoms.comm,
        )
        self._migrations: int | None = None  # of the atoms when the fit took them
        self.impulse = np.zeros((self.nodes.size, plan.dim))
        self.dissipated = self.from_nodes = 0.0

    def contains(self, x: Floats) -> Bools:
        """Which atoms, by lattice position, the fit sees."""
        depth = deepest(self._interfaces, x)
        inside: Bools = (depth > 0.0) & (depth < self._reach)
        return inside

    def apply(self, V: Floats) -> None:
        """Change the velocities of the band at the end of a coupling step; collective.

        Parameters
        ----------
        V : ndarray, shape ``(m, d)``
            Velocities of `nodes` in this step. Their next kick is due to take `impulse`, and
            `settle` to learn their velocities after it.
        """
        self._take()
        atoms, rows = self._atoms, self._rows
        before = np.concatenate([atoms.v[rows], V])
        v, times = before, self._applications()
        for _ in range(times):
            v = self._damped(v, self._strength / times)
        n, m = rows.size, self._mass
        atoms.v[rows] = v[:n]
        self.impulse = m[n:] * (v[n:] - before[n:])
        lost = 0.5 * float((m[:n] * (before[:n] - v[:n]) * (before[:n] + v[:n])).sum())
        self.dissipated += self._units.energy_from_mechanical(lost)
        self._book(V)

    def settle(self, V: Floats) -> None:
        """Learn the velocities ``V (m, d)`` of the nodes after the kick that took `impulse`."""
        self._book(V)

    def go_on(self, step: int, impulse: Floats, dissipated: float, from_nodes: float) -> None:
        """Go on from a coupling step at which so much energy had been taken out.

        The random numbers depend on site and step alone.
        """
        self._step = step * self._applications()
        self.impulse, self.dissipated, self.from_nodes = impulse, dissipated, from_nodes

    def _book(self, V: Floats) -> None:
        """Half of the impulse's work, with the velocity before the kick or after it.

        So the sum of the energies is exact at every step: at the time of a kick the kinetic energy
        of the nodes is the product of the velocities before and after it.
        """
        taken = self._units.energy_from_mechanical(-0.5 * float((self.impulse * V).sum()))
        self.dissipated += taken
        self.from_nodes += taken

    def _applications(self) -> int:
        """How often the absorber acts in a coupling step."""
        if self._heat == 0.0:
            return 1
        return max(1, int(np.ceil(self._strength / LARGEST_STRENGTH)))

    def _take(self) -> None:
        """Find the particles of this rank, if atoms have moved."""
        atoms = self._atoms
        if atoms.migrations == self._migrations:
            return
        self._migrations = atoms.migrations
        self._rows = np.flatnonzero(atoms.role & np.int32(PROJECTED))
        x = np.concatenate([atoms.site[self._rows], self._node_x])
        mass = np.concatenate([atoms.mass[self._rows], self._node_mass])
        self._fit.take(x, mass)
        self._mass, self._ramp = mass[:, None], np.zeros((len(x), 1))
        self._ramp[: self._rows.size] = self._ramp_at(x[: self._rows.size])[:, None]
        # ids of atoms depend on the patches, lattice positions do not
        self._sites = np.rint((x - self._origin) / self._pitch).astype(np.int64)

    def _damped(self, v: Floats, strength: float) -> Floats:
        """Velocities ``(n, d)`` of the particles after one application; collective."""
        noise = np.zeros_like(v)
        if self._heat > 0.0:
            size = np.sqrt(2.0 * strength * self._heat * self._mass * self._ramp)
            xi = normals(self._seed, self._step, self._sites)
            noise = self._fit.spread(size * xi) / self._mass
        self._step += 1
        rest = self._fit.rest(v + 0.25 * noise)
        force = self._fit.spread(self._mass * self._ramp * rest)
        return v + noise - strength * force / self._mass

    def _ramp_at(self, x: Floats) -> Floats:
        """D at lattice positions."""
        q = np.clip(deepest(self._interfaces, x) / self._width, 0.0, 1.0)
        ramp: Floats = 1.0 - q * q * (3.0 - 2.0 * q)
        return ramp


def _known(settings: Settings) -> tuple[float, float]:
    """Rate and width.

    Raises
    ------
    ValueError
        They are not known: the settings are not those of a plan.
    """
    if settings.rate is None or settings.width is None:
        raise ValueError("rate and width of the absorber have not been chosen")
    return settings.rate, settings.width


def _volumes(grid: BackgroundGrid) -> Floats:
    """Volume of the body that belongs to each node: half a cell on a face of the domain."""
    x, volume = grid.positions(), np.full(grid.size, grid.cell**grid.dim)
    for axis, (ends, periodic) in enumerate(zip(grid.box, grid.periodic, strict=True)):
        for end in ends:
            if not periodic:
                volume[np.abs(x[:, axis] - end) < 0.5 * grid.cell] *= 0.5
    return volume
