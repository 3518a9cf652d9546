"""Perfect crystals of active sites, ghosts and free atoms: energies as plain sums over sites."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from gimpmd_md.engines.lammps.library import own_potentials
from gimpmd_md.engines.lammps.site_off import setfl
from gimpmd_schemas.grid.zones import Box

Function = Callable[[np.ndarray, int], np.ndarray]
"""Value, first or second derivative at distances or densities."""


@dataclass(frozen=True)
class Crystal:
    """A crystal and its site energies ``F(sum rho) + sum phi / 2``.

    ``cell`` is an upright cell and ``basis`` the atoms in it; ``period`` are the shortest
    translations along the axes. The crystal is moved by ``offset``, if it is given.
    """

    cell: np.ndarray
    basis: np.ndarray
    period: np.ndarray
    cutoff: float
    phi: Function
    rho: Function | None = None
    F: Function | None = None
    offset: np.ndarray | None = None

    @property
    def dim(self) -> int:
        return len(self.cell)

    @property
    def layers(self) -> np.ndarray:
        """Distance of the layers normal to each axis; they are even."""
        return np.array([np.ptp(np.unique(x.round(9))[:2]) for x in self.basis.T])

    @property
    def midway(self) -> np.ndarray:
        """A place midway between two layers, along each axis."""
        return np.zeros(self.dim) if self.offset is None else self.offset

    @property
    def volume(self) -> float:
        """Of one atom."""
        return float(np.prod(self.cell) / len(self.basis))

    def sites(self, box: Box) -> np.ndarray:
        """Lattice sites in a box."""
        low, high = np.array(box).T
        numbers = [
            range(int(a // c) - 1, int(b // c) + 2)
            for a, b, c in zip(low - self.midway, high - self.midway, self.cell, strict=True)
        ]
        x = (np.array(list(product(*numbers)))[:, None] * self.cell + self.basis).reshape(
            -1, self.dim
        )
        x = x + self.midway
        return x[((x > low) & (x < high)).all(axis=1)]

    @cached_property
    def neighbours(self) -> np.ndarray:
        """Vectors from a site to those within the cutoff, with a margin for strain."""
        reach = 1.1 * self.cutoff
        here = self.basis[0] + self.midway
        x = self.sites(tuple((float(c) - reach, float(c) + reach) for c in here)) - here
        r = np.linalg.norm(x, axis=1)
        return x[(r > 1e-9) & (r < reach)]

    def energy(self, F: np.ndarray) -> float:
        """Energy of a site of the strained crystal."""
        r = np.linalg.norm(self.neighbours @ F.T, axis=1)
        total = 0.5 * self.phi(r, 0).sum()
        if self.F is not None:
            total += float(self.F(self.rho(r, 0).sum(), 0))
        return float(total)

    def stress(self, F: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress of the strained crystal."""
        R = self.neighbours @ F.T
        r = np.linalg.norm(R, axis=1)
        q = 0.5 * self.phi(r, 1)
        if self.F is not None:
            q = q + self.F(self.rho(r, 0).sum(), 1) * self.rho(r, 1)
        return (q / r * R.T) @ self.neighbours / self.volume

    def tangent(self) -> np.ndarray:
        """Derivative of the stress at rest, shape ``(d, d, d, d)``."""
        d, step = self.dim, 1e-5
        A = np.empty((d,) * 4)
        for k, l in product(range(d), repeat=2):  # noqa: E741
            e = np.zeros((d, d))
            e[k, l] = step
            A[:, :, k, l] = (self.stress(np.eye(d) + e) - self.stress(np.eye(d) - e)) / (2 * step)
        return A


@dataclass(frozen=True)
class Bodies:
    """Sites of a crystal, some of them active, with all pairs in range of an active site.

    The last ones may be images over periodic axes; ``images`` says of which they are. Images are
    not active: the energy is that of one period.
    """

    crystal: Crystal
    x: np.ndarray
    active: np.ndarray
    images: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    @property
    def own(self) -> int:
        """Number of sites that are no images."""
        return len(self.x) - len(self.images)

    @cached_property
    def fold(self) -> Any:
        """Which site each one is or repeats, a sparse matrix."""
        columns = np.concatenate([np.arange(self.own), self.images])
        return sparse.csr_array((np.ones(len(self.x)), (np.arange(len(self.x)), columns)))

    @cached_property
    def pairs(self) -> np.ndarray:
        found = cKDTree(self.x).query_pairs(1.05 * self.crystal.cutoff, output_type="ndarray")
        return found[self.active[found].any(axis=1)]

    def force(self, F: np.ndarray) -> np.ndarray:
        """Forces on the sites of the strained crystal, minus the derivative of the energy.

        Images move with what they repeat, so forces on them count there.
        """
        i, j = self.pairs.T
        R = (self.x[j] - self.x[i]) @ F.T
        r = np.linalg.norm(R, axis=1)
        q = self._slope(r)
        pull = (q / r)[:, None] * R
        f = np.stack(
            [
                np.bincount(i, along, len(self.x)) - np.bincount(j, along, len(self.x))
                for along in pull.T
            ],
            axis=1,
        )
        return np.asarray(self.fold.T @ f)

    def _slope(self, r: np.ndarray) -> np.ndarray:
        """Derivative of the energy of the active sites in the length of each pair."""
        c, share = self.crystal, self.active[self.pairs].astype(float)
        q = 0.5 * share.sum(axis=1) * c.phi(r, 1)
        if c.F is not None:
            embedding = np.where(self.active, c.F(self._density(r), 1), 0.0)
            q = q + embedding[self.pairs].sum(axis=1) * c.rho(r, 1)
        return q

    def _density(self, r: np.ndarray) -> np.ndarray:
        each = self.crystal.rho(r, 0)
        density = np.zeros(len(self.x))
        for end in self.pairs.T:
            np.add.at(density, end, each)
        return density

    def hessian(self) -> Any:
        """Second derivative of the energy of the active sites at rest, sparse."""
        c, n, d = self.crystal, len(self.x), self.crystal.dim
        i, j = self.pairs.T
        R = self.x[j] - self.x[i]
        r = np.linalg.norm(R, axis=1)
        share = self.active[self.pairs].astype(float)
        curvature, slope = 0.5 * share.sum(axis=1) * c.phi(r, 2), self._slope(r)
        m = np.arange(len(r))
        ends = sparse.csr_array((np.ones(len(r)), (m, j)), (len(r), n)) - sparse.csr_array(
            (np.ones(len(r)), (m, i)), (len(r), n)
        )
        B = sparse.csr_array(sparse.kron(ends @ self.fold, sparse.eye_array(d)))  # change of R
        density = None
        if c.F is not None:
            embedding = np.where(self.active, c.F(self._density(r), 1), 0.0)
            curvature = curvature + embedding[self.pairs].sum(axis=1) * c.rho(r, 2)
            unit = sparse.csr_array(
                ((R / r[:, None]).ravel(), (np.repeat(m, d), np.arange(d * len(r))))
            )
            both = sparse.csr_array((np.ones(len(r)), (i, m)), (n, len(r))) + sparse.csr_array(
                (np.ones(len(r)), (j, m)), (n, len(r))
            )
            density = both @ sparse.diags_array(c.rho(r, 1)) @ unit @ B
            second = np.where(self.active, c.F(self._density(r), 2), 0.0)
        e = R / r[:, None]
        outer = np.einsum("pi,pj->pij", e, e)
        each = curvature[:, None, None] * outer + (slope / r)[:, None, None] * (np.eye(d) - outer)
        H = B.T @ blocks(each) @ B
        if density is not None:
            H = H + density.T @ sparse.diags_array(second) @ density
        return H.tocsr()


def blocks(each: np.ndarray) -> Any:
    """Sparse matrix of blocks on the diagonal, shape ``(n, k, k)``."""
    n, k, _ = each.shape
    return sparse.bsr_array((each, np.arange(n), np.arange(n + 1)), (n * k, n * k)).tocsr()


STRENGTH = 3.0
"""Of the embedding energy of `embedded`."""


def lennard_jones(cutoff: float = 2.5) -> Crystal:
    """Hexagonal crystal in two dimensions, rows along x, at zero pressure."""

    def phi(r: np.ndarray, order: int) -> np.ndarray:
        values = (
            4.0 * (r**-12 - r**-6),
            -48.0 * r**-13 + 24.0 * r**-7,
            624.0 * r**-14 - 168.0 * r**-8,
        )[order]
        return np.where(r < cutoff, values, 0.0)

    def at(a: float) -> Crystal:
        basis = np.array([[0.25, 0.25], [0.75, 0.75]]) * a * [1.0, 3**0.5]
        cell = a * np.array([1.0, 3**0.5])
        return Crystal(cell, basis, cell, cutoff, phi)

    return at(brentq(lambda a: at(a).stress(np.eye(2))[0, 0], 1.105, 1.12, xtol=1e-15))


def embedded(cutoff: float = 2.5) -> Crystal:
    """The same with an embedding energy, so that C12 and C44 differ."""

    def rho(r: np.ndarray, order: int) -> np.ndarray:
        s = np.maximum(1.0 - r / cutoff, 0.0)
        return (s**4, -4.0 * s**3 / cutoff, 12.0 * s**2 / cutoff**2)[order]

    def embedding(density: np.ndarray, order: int) -> np.ndarray:
        return (STRENGTH * density**2, 2.0 * STRENGTH * density, 2.0 * STRENGTH + 0.0 * density)[
            order
        ]

    pairs = lennard_jones(cutoff)

    def at(factor: float) -> Crystal:
        scaled = {k: factor * getattr(pairs, k) for k in ("cell", "basis", "period")}
        return replace(pairs, rho=rho, F=embedding, **scaled)

    return at(brentq(lambda f: at(f).stress(np.eye(2))[0, 0], 0.98, 1.05, xtol=1e-15))


def spline(values: np.ndarray, step: float) -> Function:
    """The function of a table as LAMMPS interpolates it (pair_eam.cpp)."""
    slope = np.empty_like(values)
    slope[2:-2] = ((values[:-4] - values[4:]) + 8.0 * (values[3:-1] - values[1:-3])) / 12.0
    slope[0], slope[-1] = values[1] - values[0], values[-1] - values[-2]
    slope[1], slope[-2] = 0.5 * (values[2] - values[0]), 0.5 * (values[-1] - values[-3])
    table = CubicHermiteSpline(step * np.arange(len(values)), values, slope / step)
    parts = [table, table.derivative(), table.derivative(2)]
    return lambda x, order: parts[order](x)


def eam(
    name: str,
    element: str,
    a: float,
    basis: np.ndarray,
    edges: tuple[float, ...] = (1.0, 1.0, 1.0),
    period: tuple[float, ...] = (1.0, 1.0, 1.0),
) -> Crystal:
    """Cubic crystal by an eam/alloy file of LAMMPS, near the lattice constant at zero pressure.

    ``edges`` of the cell, its ``basis`` in edges, and ``period`` are in lattice constants.
    """
    tables = setfl.read_setfl(own_potentials() / name, False).take([element])
    cutoff, z = tables.cutoff, spline(tables.z[0, 0], tables.dr)
    density, embedding = spline(tables.rho[0], tables.dr), spline(tables.F[0], tables.drho)

    def phi(r: np.ndarray, order: int) -> np.ndarray:
        value = z(r, 0) / r
        if order > 0:
            slope = (z(r, 1) - value) / r
            value = slope if order == 1 else (z(r, 2) - 2.0 * slope) / r
        return np.where(r < cutoff, value, 0.0)

    def rho(r: np.ndarray, order: int) -> np.ndarray:
        return np.where(r < cutoff, density(r, order), 0.0)

    def at(a: float) -> Crystal:
        cell = a * np.array(edges)
        return Crystal(cell, cell * basis, a * np.array(period), cutoff, phi, rho, embedding)

    return at(brentq(lambda a: at(a).stress(np.eye(3))[0, 0], 0.99 * a, 1.01 * a, xtol=1e-14))


FCC = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]) + 0.25
BCC = np.array([[0, 0, 0], [0.5, 0.5, 0.5]]) + 0.25


def copper() -> Crystal:
    """Copper by Mishin et al. (2001), axes along the edges of its cell."""
    return eam("Cu_mishin1.eam.alloy", "Cu", 3.615, FCC)


def copper_110() -> Crystal:
    """The same, turned by 45 degrees about z."""
    edges = (0.5**0.5, 0.5**0.5, 1.0)
    return eam("Cu_mishin1.eam.alloy", "Cu", 3.615, BCC, edges, edges)


def copper_111() -> Crystal:
    """The same with x along [1-10], y along [111], z along [11-2]."""
    edges = (0.5**0.5, 3**0.5, 1.5**0.5)
    k = np.arange(3)[:, None] / 3.0
    basis = np.concatenate([np.hstack([0 * k, k, k]), np.hstack([0 * k + 0.5, k, (k + 0.5) % 1.0])])
    basis = np.add(basis, [1 / 4, 1 / 6, 1 / 12])
    return eam("Cu_mishin1.eam.alloy", "Cu", 3.615, basis, edges, edges)


def turned(name: str, element: str, a: float, cubic: np.ndarray, axes: np.ndarray) -> Crystal:
    """Cubic crystal with one atom per primitive cell, with orthogonal axes given by indices."""
    edges, basis = upright(cubic, axes)
    lengths = tuple(edges.tolist())
    return eam(name, element, a, basis, lengths, lengths)


def upright(cubic: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least upright cell of a cubic lattice along orthogonal axes, given by indices.

    Parameters
    ----------
    cubic : ndarray, shape ``(n, 3)``
        Atoms of the cubic cell, in lattice constants.
    axes : ndarray, shape ``(3, 3)``
        Its rows are the indices.

    Returns
    -------
    edges : ndarray, shape ``(3,)``
        Of the cell, in lattice constants.
    basis : ndarray, shape ``(m, 3)``
        Atoms in it, in edges; the first layers lie half a layer inside its lower faces.
    """
    sites = cubic - cubic[0]  # translations, to whole numbers
    edges = np.array([next(e for e in (0.5 * i, i) if _is_among(e, sites)) for i in axes])
    most = np.abs(edges).sum(axis=0).max() + 1.0
    numbers = np.array(list(product(np.arange(-np.ceil(most), most + 1.0), repeat=3)))
    x = (numbers[:, None] + sites).reshape(-1, 3) @ np.linalg.inv(edges)
    x = x[((x > -1e-9) & (x < 1.0 - 1e-9)).all(axis=1)]
    layers = np.array([np.ptp(np.unique(along.round(9))[:2]) for along in x.T])
    return np.linalg.norm(edges, axis=1), x + 0.5 * layers


def _is_among(translation: np.ndarray, sites: np.ndarray) -> bool:
    away = translation - sites
    return bool(np.isclose(away, np.rint(away)).all(axis=1).any())


def aluminium() -> Crystal:
    """Aluminium by Zhou et al. (2004)."""
    return eam("Al_zhou.eam.alloy", "Al", 4.05, FCC)


def iron() -> Crystal:
    """Iron by Mendelev et al. (2003); with one element eam/fs has the format of eam/alloy."""
    return eam("Fe_mm.eam.fs", "Fe", 2.8553, BCC)


def tungsten() -> Crystal:
    """Tungsten by Zhou et al. (2004)."""
    return eam("W_zhou.eam.alloy", "W", 3.165, BCC)
