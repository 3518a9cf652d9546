"""What a constitutive law must offer, and the tools that laws share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, Protocol

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.mechanics import elasticity

kernel = njit(nogil=True, cache=True, fastmath={"contract"})
"""Compile a sweep over points; it releases the interpreter, and sums keep their order."""

Kernels = Sequence[Callable[..., None]]

VOIGT = {1: ((0, 0),), **elasticity.VOIGT}
"""Components of a symmetric tensor in Voigt's order, by dimension."""


class Law(Protocol):
    """A constitutive law with a strain energy (hyperelastic), in 1, 2 or 3 dimensions.

    All quantities are in mechanical units (mass, length and time of the case's unit style, so
    that ``F = m a`` holds without a factor), per area in two dimensions, per length in one.

    To add a law, write a class with these members; the solver needs no change. The arrays of
    all points are handed in, and the law serves those in ``order[first:last]``: threads share
    the points this way, so a law writes nothing but these rows of ``out``. ``kernel`` compiles
    a sweep as the laws here have it.
    """

    @property
    def name(self) -> str:
        """What the law is called in logs and messages."""
        ...

    @property
    def density(self) -> float:
        """Mass per reference volume."""
        ...

    @property
    def finite(self) -> bool:
        """How the solver advances F with the velocity gradient L.

        False, small strain: ``F += dt L``. True: ``F <- (I + dt L) F``.
        """
        ...

    def stress(self, order: Ints, first: int, last: int, F: Floats, out: Floats) -> None:
        """Kirchhoff stress ``tau = J sigma``; symmetric.

        Parameters
        ----------
        order : ndarray of int64
            Indices of points; those in ``order[first:last]`` are served.
        F : ndarray, shape ``(n, d, d)``
            Deformation gradients of all points.
        out : ndarray, shape ``(n, d, d)``
            Where the stresses go.
        """
        ...

    def energy(self, order: Ints, first: int, last: int, F: Floats, out: Floats) -> None:
        """Strain energy per reference volume into ``out``, shape ``(n,)``; see ``stress``."""
        ...

    def wave_speed(self) -> float:
        """Speed of the fastest longitudinal wave at ``F = I``, in any direction."""
        ...


def by_dimension(make: Callable[[int], Callable[..., None]]) -> Kernels:
    """Kernels for 1, 2 and 3 dimensions from one source.

    ``make(d)`` returns the kernel, in which the loops over components have constant bounds and
    are unrolled. Index the result with ``F.shape[1]``. A kernel may close over numbers alone:
    numba would not find one that closes over another kernel in its cache again.
    """
    return [make(d) if d else _no_dimension for d in range(4)]


def _no_dimension(*_: Any) -> None:
    raise ValueError("a deformation gradient has 1, 2 or 3 dimensions")


def fastest_wave(stiffness: Floats, density: float) -> float:
    """Fastest plane wave of any direction and polarization in an anisotropic solid.

    The speed c along n with polarization a obeys ``density c^2 = C_ijkl a_i n_j a_k n_l``. For a
    fixed n the best a is an eigenvector; by the symmetries of C the same holds the other way
    round, so exchanging the two climbs to a maximum. It starts from all axes and diagonals.

    Parameters
    ----------
    stiffness : ndarray, shape ``(m, m)``
        In Voigt's notation with engineering shear strains; m is 1, 3 or 6.
    """
    d = {1: 1, 3: 2, 6: 3}[stiffness.shape[0]]
    place = np.empty((d, d), dtype=np.int64)
    for v, (i, j) in enumerate(VOIGT[d]):
        place[i, j] = place[j, i] = v
    C = stiffness[place[:, :, None, None], place[None, None]]
    best = 0.0
    for start in product((0.0, 1.0, -1.0), repeat=d):
        n = np.array(start)
        modulus, found = -1.0, 0.0
        while found > modulus * (1.0 + 1e-14) and n.any():
            modulus = found
            values, vectors = np.linalg.eigh(np.einsum("ijkl,j,l->ik", C, n, n) / (n @ n))
            found, n = float(values[-1]), vectors[:, -1]
        best = max(best, found)
    return float((best / density) ** 0.5)
