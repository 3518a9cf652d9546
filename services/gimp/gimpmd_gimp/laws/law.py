"""The interface of a constitutive law, and the tools that laws share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, Protocol, TypeGuard

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.mechanics import elasticity

kernel = njit(nogil=True, cache=True, fastmath={"contract"})
"""Compile a loop over points. It releases the interpreter lock and keeps the order of sums."""


@kernel
def squared(x: float) -> float:
    """``x x``, for compiled loops in place of ``x**2``.

    numba compiles a power once in a process, for all functions. Whether its products are contracted
    with sums depends on which function came first, and so does the last bit of an energy.
    """
    return x * x


Kernels = Sequence[Callable[..., None]]

TRUSTED = 0.1
"""Norm of the strain up to which laws of small strains, and laws of crystals, can be trusted.

There the squares that a law of small strains leaves out, ``F^T F / 2``, are 5 % of the strain. A
crystal is about to break: the force of a Lennard-Jones bond is largest at a stretch of 1.11, a
strain of 0.116. Energies of crystals, which are fitted up to smaller strains, are continued
quadratically; at 0.1 the force of such a bond is then wrong by 12 % in tension and by 26 % in
compression.
"""

History = tuple[tuple[str, int], ...]
"""Names of history variables, and how many components each of them has."""

VOIGT = {1: ((0, 0),), **elasticity.VOIGT}
"""Components of a symmetric tensor in Voigt order, by dimension."""


class Law(Protocol):
    """A constitutive law in one, two or three dimensions.

    All quantities are in mechanical units (mass, length and time of the unit style of the case, so
    that ``F = m a`` needs no factor). They are per area in two dimensions and per length in one.

    A law is a class with these members, in a module of its own. The solver needs no change for a
    new law. Methods receive the arrays of all points and evaluate the points in
    ``order[first:last]``. Threads share the points in this way, so a law writes only the rows of
    these points. Compile the loop over the points with ``kernel``.

    Stress and energy depend only on the deformation gradient and the history variables, and do
    not change them. A law with history variables is an `InelasticLaw`.
    """

    @property
    def name(self) -> str:
        """Name of the law in logs and messages."""
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

    @property
    def history(self) -> History:
        """Columns of the history variables, in order; empty for elastic laws.

        All history variables are zero at the start of a run. The output has a field for each.
        """
        ...

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress ``tau = J sigma``, which is symmetric.

        Parameters
        ----------
        order : ndarray of int64
            Indices of points. Those in ``order[first:last]`` are evaluated.
        F : ndarray, shape ``(n, d, d)``
            Deformation gradients of all points.
        history : ndarray, shape ``(n, k)``
            History variables of all points; k is 0 for elastic laws.
        out : ndarray, shape ``(n, d, d)``
            Receives the stress.
        """
        ...

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Stored energy per reference volume, written to ``out`` of shape ``(n,)``.

        The other parameters are those of ``stress``.
        """
        ...

    def wave_speed(self) -> float:
        """Speed of the fastest longitudinal wave at ``F = I``, in any direction."""
        ...

    @property
    def trusted_strain(self) -> float:
        """Largest norm of the strain at which the law can be trusted; inf if there is none.

        The strain is ``sym(F) - I`` for laws of small strains, otherwise Green and Lagrange's. The
        norm is the root of the sum of all squared components. A strain beyond the limit is a
        finding (`gimpmd_schemas.wire.findings`), and changes nothing else.
        """
        ...


class InelasticLaw(Law, Protocol):
    """A law whose stress also depends on history variables.

    The solver calls ``update`` once after each change of F, and nowhere else. An integrator that
    deforms the points twice in a step (USAVG) therefore updates them twice. Output, energies and
    J-integrals only read the history variables.

    Where points merge, the merged point gets the volume-weighted mean of F and of the history
    variables.
    """

    def update(self, order: Ints, first: int, last: int, F: Floats, history: Floats) -> None:
        """Advance the history variables, in place, after F has changed.

        The parameters are those of ``stress``.
        """
        ...

    def dissipation(self, order: Ints, first: int, last: int, history: Floats, out: Floats) -> None:
        """Energy per reference volume that has been dissipated since the start.

        It is written to ``out`` of shape ``(n,)``. The other parameters are those of ``stress``.
        """
        ...


LawMakers = Mapping[type, Callable[[Any, Plan], Law]]
"""What makes the law of a material of a plan, by the type of the material.

A module of a law that a case file can ask for has one with the name ``MATERIALS``.
"""


def is_inelastic(law: Law) -> TypeGuard[InelasticLaw]:
    """Whether a law has history variables."""
    return bool(law.history)


def history_size(law: Law) -> int:
    """Number of columns of a law's history variables."""
    return sum(size for _, size in law.history)


def history_fields(law: Law, history: Floats) -> dict[str, Floats]:
    """History variables by name: shape ``(n,)``, or ``(n, m)`` for m > 1 components.

    Parameters
    ----------
    history : ndarray, shape ``(n, k)``
    """
    fields, start = {}, 0
    for name, size in law.history:
        columns = history[:, start : start + size]
        fields[name] = columns[:, 0] if size == 1 else columns
        start += size
    return fields


def by_dimension(make: Callable[[int], Callable[..., None]]) -> Kernels:
    """Compile kernels for one, two and three dimensions from one source.

    ``make(d)`` returns the kernel for d dimensions. Its loops over components have constant bounds,
    so the compiler unrolls them. Index the result with ``F.shape[1]``. A kernel may close over
    numbers but not over another kernel, because numba could not read it from its cache again.
    """
    return [make(d) if d else _no_dimension for d in range(4)]


def _no_dimension(*_: Any) -> None:
    raise ValueError("a deformation gradient has 1, 2 or 3 dimensions")


def fastest_wave(stiffness: Floats, density: float) -> float:
    """Speed of the fastest plane wave, over all directions and polarizations.

    The speed c along n with polarization a satisfies ``density c^2 = C_ijkl a_i n_j a_k n_l``. For
    a given n the best a is an eigenvector. The symmetries of C allow to exchange a and n, so
    alternating between the two climbs to a maximum. The search starts from all axes and diagonals.

    Parameters
    ----------
    stiffness : ndarray, shape ``(m, m)``
        In Voigt order with engineering shear strains; m is 1, 3 or 6.
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
