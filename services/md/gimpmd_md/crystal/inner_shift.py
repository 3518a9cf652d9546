"""How the atoms of a primitive cell move against each other in the strained crystal.

In a crystal with a basis, atoms do not follow a uniform strain exactly. To first order the atom b
of a primitive cell moves by ``kappa_b : grad u`` in addition, the inner shift of its sublattice.
The mean of kappa_b over the atoms of a cell is zero, so a crystal with one atom per cell has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_md.crystal.recognise import distances
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Sites
from gimpmd_schemas.mechanics.elasticity import voigt_place


@dataclass(frozen=True)
class InnerShift:
    """Inner shifts of a crystal, by position.

    Attributes
    ----------
    vectors, origin, basis : ndarray
        See `recognise.Crystal`.
    tensors : ndarray, shape ``(b, d, d, d)``
        kappa of each atom of the basis (length). It is symmetric in the last two indices.
    """

    vectors: Floats
    origin: Floats
    basis: Floats
    tensors: Floats

    def at(self, x: Floats) -> Floats:
        """Give kappa of the atoms at lattice positions ``(n, d)``, shape ``(n, d, d, d)``."""
        member = distances(self.vectors, self.origin, self.basis, x).argmin(axis=0)
        return np.asarray(self.tensors[member])


def of_plan(sites: Sites) -> InnerShift:
    """Inner shifts that have been measured."""
    dim = len(sites.origin)
    by_strain = np.frombuffer(sites.shift, dtype="<f8").reshape(len(sites.basis), -1, dim)
    return InnerShift(
        np.array(sites.vectors),
        np.array(sites.origin),
        np.array(sites.basis),
        tensors(by_strain),
    )


def tensors(by_strain: Floats) -> Floats:
    """Arrange shifts in each strain of `unit_strains`, ``(b, c, d)``, as kappa ``(b, d, d, d)``."""
    place = voigt_place(by_strain.shape[2])
    return np.ascontiguousarray(np.moveaxis(by_strain[:, place], 3, 1))


def shifts(kappa: Floats, gradient: Floats) -> Floats:
    """Inner shifts ``kappa : grad u`` of atoms, shape ``(n, d)``.

    Parameters
    ----------
    kappa : ndarray, shape ``(n, d, d, d)``
    gradient : ndarray, shape ``(n, d, d)``
        ``du_i / dx_j``, or its rate.
    """
    return np.asarray(np.einsum("nmij,nij->nm", kappa, gradient))


def couples(kappa: Floats, force: Floats) -> Floats:
    """What forces on atoms do on the displacement gradient, ``f . kappa``: transpose of `shifts`.

    Parameters
    ----------
    kappa : ndarray, shape ``(n, d, d, d)``
    force : ndarray, shape ``(n, d)``

    Returns
    -------
    ndarray, shape ``(n, d, d)``
        Force times length.
    """
    return np.asarray(np.einsum("nmij,nm->nij", kappa, force))
