"""Second derivatives of the energy of active sites in a perfect crystal, measured by LAMMPS.

The energy is a sum over sites, and a site of a perfect crystal has the same energy as every other
one with the same neighbours. So it is enough to measure one site: LAMMPS gives the forces in a
cluster of a site that is on and its neighbours, which are off, when each of them is moved. Sites at
faces of the body lack neighbours; every arrangement of neighbours is measured by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from gimpmd_md.crystal.recognise import SAME, Crystal, CrystalSites
from gimpmd_schemas.arrays import Bools, Floats, Ints

MOVED = 5e-6
"""Displacement of the central differences, over the cutoff."""

APART = 4.0
"""Distance of the middles of clusters, in cutoffs."""

ZERO = 1e-12
"""Second derivatives below this, over the largest, are round-off."""

Forces = Callable[[Floats, Ints, Bools, Sequence[Floats]], Floats]
"""Forces ``(m, n, d)`` on the atoms of a cluster, from their sites ``(n, d)``, their types, which
sites are off, and m arrays of positions; see `measure.forces`."""


class Cluster(NamedTuple):
    """Active sites with the same neighbours.

    Attributes
    ----------
    places : ndarray, shape ``(m, d)``
        A site, which is the first, and its neighbours, relative to it.
    kinds : ndarray of int, shape ``(m,)``
        Their types.
    atoms : ndarray of int, shape ``(n, m)``
        Numbers of the atoms there, for each of the n active sites.
    """

    places: Floats
    kinds: Ints
    atoms: Ints


def stiffness(
    crystal: Crystal,
    sites: CrystalSites,
    active: Bools,
    cutoff: float,
    body: Sequence[tuple[float, float] | None],
    forces: Forces,
) -> sparse.csr_array:
    """Second derivatives of the energy of the active sites in all atoms.

    Parameters
    ----------
    crystal : Crystal
        At rest.
    sites : CrystalSites
        Of all atoms within a cutoff of active sites, n of them. The crystal ends where there are
        none.
    active : ndarray of bool, shape ``(n,)``
    cutoff : float
        Range of the potential (length).
    body : sequence
        Ends of the body along periodic axes (length); None along the others.
    forces : callable
        LAMMPS.

    Returns
    -------
    sparse matrix, shape ``(n d, n d)``
        Force / length.
    """
    clusters = list(_clusters(crystal, sites, active, cutoff, body))
    found = list(zip(clusters, _of_sites(clusters, cutoff, forces), strict=True))
    return _assembled(found, len(sites.x))


def _clusters(
    crystal: Crystal,
    sites: CrystalSites,
    active: Bools,
    cutoff: float,
    body: Sequence[tuple[float, float] | None],
) -> Iterator[Cluster]:
    """Sort active sites by their neighbours."""
    slack = SAME * float(np.linalg.norm(crystal.vectors[0]))
    low = np.array(
        [ends[0] - slack if ends else sites.x[:, k].min() for k, ends in enumerate(body)]
    )
    around = [ends[1] - ends[0] if ends else 0.0 for ends in body]
    tree = cKDTree(sites.x - low, boxsize=around)
    for member in range(len(crystal.basis)):
        places, kinds = _neighbours(crystal, member, cutoff)
        own = np.flatnonzero(active & (sites.member == member))
        away, atoms = tree.query(sites.x[own, None] - low + places)
        present = away < slack
        for there, row in zip(*_unique_rows(present), strict=True):
            yield Cluster(places[there], kinds[there], atoms[row][:, there])


def _unique_rows(rows: Bools) -> tuple[Bools, list[Ints]]:
    """Different rows, and where they are."""
    unique, number = np.unique(rows, axis=0, return_inverse=True)
    return unique, [np.flatnonzero(number.ravel() == k) for k in range(len(unique))]


def _neighbours(crystal: Crystal, member: int, cutoff: float) -> tuple[Floats, Ints]:
    """A site and its neighbours, relative to it, and their types."""
    here = crystal.origin + crystal.basis[member]
    found = crystal.sites(tuple((c - cutoff, c + cutoff) for c in here.tolist()))
    away = found.x - here
    distance = np.linalg.norm(away, axis=1)
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] < cutoff]
    return away[order], crystal.kinds[found.member[order]]


def _of_sites(clusters: Sequence[Cluster], cutoff: float, forces: Forces) -> list[Floats]:
    """Second derivatives of the energy of one site of each cluster, shape ``(m, d, m, d)``.

    The clusters lie out of each other's range, so that they are measured together.
    """
    sizes = [each.places.size for each in clusters]
    dim = clusters[0].places.shape[1]
    shape = (math.ceil(len(clusters) ** (1.0 / dim)),) * dim
    corners = APART * cutoff * np.transpose(np.unravel_index(np.arange(len(clusters)), shape))
    x = np.concatenate([each.places + at for each, at in zip(clusters, corners, strict=True)])
    kinds = np.concatenate([each.kinds for each in clusters])
    ends = np.cumsum([0, *sizes])
    off = np.ones(len(x), dtype=np.bool_)
    off[ends[:-1] // dim] = False
    step, moved = MOVED * cutoff, []
    for number in range(max(sizes)):
        away = np.zeros(x.size)
        away[[at + number for at, size in zip(ends[:-1], sizes, strict=True) if number < size]] = (
            step
        )
        moved += [x + away.reshape(x.shape), x - away.reshape(x.shape)]
    found = forces(x, kinds, off, moved)
    change = ((found[1::2] - found[::2]) / (2.0 * step)).reshape(max(sizes), -1)
    square = [change[:size, at : at + size] for at, size in zip(ends[:-1], sizes, strict=True)]
    return [
        (0.5 * (V + V.T)).reshape(each.places.shape * 2)
        for each, V in zip(clusters, square, strict=True)
    ]


def _assembled(found: Sequence[tuple[Cluster, Floats]], count: int) -> sparse.csr_array:
    """Sum over all active sites, from the second derivatives of one of each cluster.

    An atom has few different vectors to the atoms that it is bound to, so the blocks of a row are
    numbered by them.
    """
    bound = [np.argwhere(np.abs(V).max(axis=(1, 3)) > ZERO * np.abs(V).max()) for _, V in found]
    vectors = [
        cluster.places[b] - cluster.places[a]
        for (cluster, _), (a, b) in zip(found, (pairs.T for pairs in bound), strict=True)
    ]
    lengths = SAME * max(np.abs(each).max() for each in vectors)
    different, number = np.unique(
        np.round(np.concatenate(vectors) / lengths), axis=0, return_inverse=True
    )
    dim = different.shape[1]
    blocks = np.zeros((count, len(different), dim, dim))
    column = np.full((count, len(different)), -1)
    numbers = iter(number.ravel().tolist())
    for (cluster, V), pairs in zip(found, bound, strict=True):
        for a, b in pairs:
            place = cluster.atoms[:, a], next(numbers)
            blocks[place] += V[a, :, b]
            column[place] = cluster.atoms[:, b]
    there = column >= 0
    starts = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    matrix = sparse.bsr_array((blocks[there], column[there], starts), shape=(count * dim,) * 2)
    return matrix.tocsr()
