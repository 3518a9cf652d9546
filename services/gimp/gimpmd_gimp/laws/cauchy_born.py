"""Hyperelasticity of a crystal: the energy is a polynomial in the Green-Lagrange strain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from gimpmd_gimp.laws.law import (
    TRUSTED,
    VOIGT,
    History,
    LawMakers,
    by_dimension,
    fastest_wave,
    kernel,
)
from gimpmd_gimp.laws.thermal import stress_of_plan
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import Hyperelastic
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics import hyperelastic
from gimpmd_schemas.mechanics.hyperelastic import degree_of, exponents
from gimpmd_schemas.mechanics.units import UNITS

LANES = 64
"""Points that are evaluated together, so that the processor's vector units are used."""

Tables = tuple[Ints, Ints, Ints, Ints, Floats]
"""The tables that `_tabulate` returns."""


@dataclass(frozen=True, eq=False)
class CauchyBorn:
    """Second Piola-Kirchhoff stress ``S = dW/dE + rest``, ``tau = F S F^T``, ``2 E = F^T F - I``.

    By the hypothesis of Cauchy and Born the lattice deforms as the body does, so the energy W of
    the crystal is that of its periodic cell. `gimpmd_schemas.mechanics.hyperelastic` defines the
    polynomial W, and how it continues at strains beyond the limit.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    coefficients : ndarray
        Coefficients of W (mechanical units), in the order of ``hyperelastic.exponents``.
    strain_limit : float
        Norm of the strain up to which the polynomial holds.
    dimension : int
        2 or 3.
    rest : ndarray, shape ``(n,)``, optional
        Stress at rest, such as the thermal stress (mechanical units), in Voigt order; zero by
        default. Its energy is ``rest : E``.

    Raises
    ------
    ValueError
        No polynomial in this dimension has that number of coefficients.
    """

    density: float
    coefficients: Floats
    strain_limit: float
    dimension: int = 2
    rest: Floats | None = None
    _tables: Tables = field(init=False, repr=False)

    name: ClassVar[str] = "Cauchy-Born"
    finite: ClassVar[bool] = True
    history: ClassVar[History] = ()

    def __post_init__(self) -> None:
        coefficients = np.array(self.coefficients, dtype=float)
        coefficients.flags.writeable = False
        object.__setattr__(self, "coefficients", coefficients)
        n = len(VOIGT[self.dimension])
        object.__setattr__(self, "_tables", _tabulate(coefficients, n))
        rest = np.zeros(n) if self.rest is None else np.array(self.rest, dtype=float)
        rest.flags.writeable = False
        object.__setattr__(self, "rest", rest)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        _STRESS[self.dimension](
            order, first, last, F, self._tables, self.strain_limit, self.rest, out
        )

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Strain energy; see `Law`."""
        _ENERGY[self.dimension](
            order, first, last, F, self._tables, self.strain_limit, self.rest, out
        )

    def wave_speed(self) -> float:
        """Speed of the fastest wave at rest, over all directions.

        Waves are faster in a compressed crystal, which is stiffer.
        """
        C = hyperelastic.stiffness(len(VOIGT[self.dimension]), self.coefficients)
        return fastest_wave(C, self.density)

    @property
    def trusted_strain(self) -> float:
        """Strain of a crystal that is about to break, or the limit of the polynomial; see `Law`."""
        return max(TRUSTED, self.strain_limit)


def from_material(material: Hyperelastic, plan: Plan) -> CauchyBorn:
    """Law of a material ``from: hyperelastic``."""
    coefficients = UNITS[plan.units].stress_to_mechanical(1.0) * np.array(material.coefficients)
    return CauchyBorn(
        material.density, coefficients, material.strain_limit, plan.dim, stress_of_plan(plan)
    )


MATERIALS: LawMakers = {Hyperelastic: from_material}


def _tabulate(coefficients: Floats, n: int) -> Tables:
    """Tables with which kernels evaluate the gradients of the parts P_k, each of degree k, of W.

    Returns
    -------
    parent, factor : ndarray of int64, shape ``(monomials,)``
        Monomial t is monomial ``parent[t]`` times strain component ``factor[t]``. The first
        monomial is 1.
    start : ndarray of int64, shape ``((degree - 1) n + 1,)``
        First entry of each derivative. ``dP_k/dE_v`` has the entries from ``start[i]`` up to
        ``start[i + 1]``, with ``i = (k - 2) n + v``.
    monomial, weight : ndarray
        Entries. A derivative is the sum over its entries of ``weight`` times the monomial with
        index ``monomial``. Terms whose coefficient is zero have no entry.
    """
    degree = degree_of(n, coefficients.size)
    if degree is None:
        raise ValueError(f"no polynomial in {n} strains has {coefficients.size} coefficients")
    unit = np.eye(n, dtype=np.int64)
    lower = [np.zeros(n, dtype=np.int64), *unit, *exponents(n, degree - 1)]
    place = {tuple(a): t for t, a in enumerate(lower)}
    factor = np.array([0] + [np.flatnonzero(a)[-1] for a in lower[1:]])
    parent = np.array(
        [0] + [place[tuple(a - unit[v])] for a, v in zip(lower[1:], factor[1:], strict=True)]
    )

    entries: list[list[tuple[int, float]]] = [[] for _ in range((degree - 1) * n)]
    for a, c in zip(exponents(n, degree), coefficients, strict=True):
        for v in np.flatnonzero(a) if c != 0.0 else ():
            entries[(a.sum() - 2) * n + v].append((place[tuple(a - unit[v])], c * a[v]))
    start = np.cumsum([0] + [len(row) for row in entries])
    pairs = [pair for row in entries for pair in row]
    return (
        parent,
        factor,
        start,
        np.array([t for t, _ in pairs], dtype=np.int64),
        np.array([c for _, c in pairs], dtype=np.float64),
    )


@kernel
def _strains(order: Ints, first: int, count: int, F: Floats, d: int, E: Floats) -> None:
    """Write the Green-Lagrange strains of ``count`` points to ``E (n, LANES)``, in Voigt order."""
    for lane in range(count):
        p = np.uint64(order[first + lane])  # unsigned: no test for indices from the end
        for i in range(d):
            for j in range(i, d):
                c = 0.0
                for m in range(d):
                    c += F[p, m, i] * F[p, m, j]
                if i == j:
                    E[i, lane] = 0.5 * (c - 1.0)
                else:  # yz, xz, xy follow the normal components
                    E[d if d == 2 else 6 - i - j, lane] = c


@kernel
def _monomials(E: Floats, tables: Tables, m: Floats) -> None:
    """Write all monomials up to the degree of the gradient to ``m (monomials, LANES)``."""
    parent, factor = tables[0], tables[1]
    for lane in range(LANES):
        m[0, lane] = 1.0
    for t in range(1, parent.size):
        a, v = np.uint64(parent[t]), np.uint64(factor[t])
        for lane in range(LANES):
            m[t, lane] = m[a, lane] * E[v, lane]


@kernel
def _gradient(k: int, tables: Tables, m: Floats, G: Floats) -> None:
    """Write the gradient of the part P_k to ``G (n, LANES)``."""
    _, _, start, monomial, weight = tables
    n = G.shape[0]
    for v in range(n):
        i = (k - 2) * n + v
        for lane in range(LANES):
            G[v, lane] = 0.0
        for entry in range(start[i], start[i + 1]):
            c, t = weight[entry], np.uint64(monomial[entry])
            for lane in range(LANES):
                G[v, lane] += c * m[t, lane]


@kernel
def _norm(E: Floats, d: int, norm: Floats) -> float:
    """Write ``|E|`` of every lane to ``norm (LANES,)``, and return the largest of them."""
    norm[:] = 0.0
    for v in range(E.shape[0]):
        # an engineering shear is twice a component that occurs twice in the tensor
        share = 1.0 if v < d else 0.5
        for lane in range(LANES):
            norm[lane] += share * E[v, lane] * E[v, lane]
    most = 0.0
    for lane in range(LANES):
        norm[lane] = np.sqrt(norm[lane])
        most = max(most, norm[lane])
    return most


@kernel
def _continue(
    E: Floats,
    d: int,
    tables: Tables,
    limit: float,
    m: Floats,
    norm: Floats,
    scratch: Floats,
    G: Floats,
    W: Floats,
    S: Floats,
) -> None:
    """Write energies to ``W (LANES,)`` and slopes to ``S (n, LANES)``, at any strain.

    With ``s = max(1, |E| / limit)`` the energy is the sum of ``f_k P_k(E)``, where
    ``f_k = (1 + k (s - 1) + k (k - 1) / 2 (s - 1)^2) / s^k``, because P_k is homogeneous. By
    Euler's theorem ``k P_k = G . E`` with the gradient G of P_k.
    """
    n = E.shape[0]
    s, power, f, part = scratch[0], scratch[1], scratch[2], scratch[3]
    W[:] = 0.0
    S[:] = 0.0
    for lane in range(LANES):
        norm[lane] = max(norm[lane], limit)
        s[lane] = norm[lane] / limit
        power[lane] = 1.0 / s[lane]
    for k in range(2, 2 + tables[2].size // n):
        _gradient(k, tables, m, G)
        part[:] = 0.0
        for v in range(n):
            for lane in range(LANES):
                part[lane] += G[v, lane] * E[v, lane] / k
        for lane in range(LANES):
            ahead = s[lane] - 1.0
            power[lane] /= s[lane]
            f[lane] = (1.0 + k * ahead + 0.5 * k * (k - 1) * ahead * ahead) * power[lane]
            W[lane] += f[lane] * part[lane]
            slope = k * (1.0 + (k - 1) * ahead) * power[lane] - k * f[lane] / s[lane]
            part[lane] *= slope / (limit * norm[lane])  # ds/dE = E / (limit |E|)
        for v in range(n):
            share = 1.0 if v < d else 0.5
            for lane in range(LANES):
                S[v, lane] += f[lane] * G[v, lane] + share * part[lane] * E[v, lane]


def _make_stress(d: int) -> Callable[..., None]:
    voigt, n = VOIGT[d], len(VOIGT[d])

    @kernel
    def stress(
        order: Ints,
        first: int,
        last: int,
        F: Floats,
        tables: Tables,
        limit: float,
        rest: Floats,
        out: Floats,
    ) -> None:
        E, G, S = np.zeros((n, LANES)), np.zeros((n, LANES)), np.zeros((n, LANES))
        m, W, norm = np.zeros((tables[0].size, LANES)), np.zeros(LANES), np.zeros(LANES)
        scratch = np.zeros((4, LANES))
        for begin in range(first, last, LANES):
            count = min(LANES, last - begin)
            _strains(order, begin, count, F, d, E)
            _monomials(E, tables, m)
            if _norm(E, d, norm) > limit:
                _continue(E, d, tables, limit, m, norm, scratch, G, W, S)
            else:  # f_k = 1: same bits as above, so that a point does not depend on its neighbours
                S[:] = 0.0
                for k in range(2, 2 + tables[2].size // n):
                    _gradient(k, tables, m, G)
                    for v in range(n):
                        for lane in range(LANES):
                            S[v, lane] += G[v, lane]
            for v in range(n):
                for lane in range(LANES):
                    S[v, lane] += rest[v]
            for lane in range(count):
                p = np.uint64(order[begin + lane])
                for i in range(d):
                    for j in range(i + 1):
                        tau = 0.0
                        for v in range(n):
                            a, b = voigt[v]
                            tau += S[v, lane] * F[p, i, a] * F[p, j, b]
                            if a != b:
                                tau += S[v, lane] * F[p, i, b] * F[p, j, a]
                        out[p, i, j] = tau
                        out[p, j, i] = tau

    return stress


def _make_energy(d: int) -> Callable[..., None]:
    n = len(VOIGT[d])

    @kernel
    def energy(
        order: Ints,
        first: int,
        last: int,
        F: Floats,
        tables: Tables,
        limit: float,
        rest: Floats,
        out: Floats,
    ) -> None:
        E, G, S = np.zeros((n, LANES)), np.zeros((n, LANES)), np.zeros((n, LANES))
        m, W, norm = np.zeros((tables[0].size, LANES)), np.zeros(LANES), np.zeros(LANES)
        scratch = np.zeros((4, LANES))
        for begin in range(first, last, LANES):
            count = min(LANES, last - begin)
            _strains(order, begin, count, F, d, E)
            _monomials(E, tables, m)
            _norm(E, d, norm)
            _continue(E, d, tables, limit, m, norm, scratch, G, W, S)
            for v in range(n):
                for lane in range(LANES):
                    W[lane] += rest[v] * E[v, lane]
            for lane in range(count):
                out[order[begin + lane]] = W[lane]

    return energy


_STRESS = by_dimension(_make_stress)
_ENERGY = by_dimension(_make_energy)
