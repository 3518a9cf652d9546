"""Straight and plane cracks: a second velocity field on the nodes near them.

If the straight line between a point and a node crosses a crack, the point uses the *twin* of the
node: a node at the same position with its own mass, momentum and force (the multiple velocity
fields of Guo and Nairn, CMES 6 (2004) 295). A constrained node near a crack has a twin as well. It
takes its value from parents, or twins of parents, on its own side.

Cracks are fixed in space, and a point stays on the side of its reference position. This is valid
while the body near a crack moves by less than a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.sweeps.kernels import Stencils
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints
from gimpmd_schemas.compiled import njit

TWIN_CELLS = 2.75
"""Distance from a crack, in cells, within which nodes get twins: half the diagonal of a stencil in
three dimensions."""

CUT_CELLS = 3.25
"""Distance from a crack, in cells, within which a crack may cut the stencil of a point before the
points are sorted again."""

TIP_GAP = 1e-6
"""Length, in cells, by which a tip is drawn back, so that a node at the end of a crack has no
twin."""

EXTENSION = 8.0
"""Length, in cells, by which a crack that ends on a face of the domain continues outside."""

ON_CRACK = 1e-9
"""Distance, in cells, within which a node lies on a crack; it belongs to the upper side."""


@dataclass(frozen=True)
class Cracks:
    """Cracks ``x = origin + sum_k t_k edge_k`` with all t between 0 and 1.

    There is one edge in two dimensions and two in three. Images across periodic faces are cracks
    as well.

    Attributes
    ----------
    origin : ndarray, shape ``(c, d)``
    edges : ndarray, shape ``(c, d - 1, d)``
    dual : ndarray, shape ``(c, d - 1, d)``
        Vectors in the crack that give the coordinates ``t_k = dual_k . (x - origin)``.
    normal : ndarray, shape ``(c, d)``
        Unit vectors to the upper side.
    hierarchy : Hierarchy
    friction : float, optional
        Coulomb's coefficient where faces touch (``contact.py``). None: faces may overlap.
    """

    origin: Floats
    edges: Floats
    dual: Floats
    normal: Floats
    hierarchy: Hierarchy
    friction: float | None = None

    def doubled(self, level: int, x: Floats) -> Bools:
        """Which nodes of a level, at positions ``(n, d)``, get a twin."""
        return self.near(x, np.full(x.shape[0], TWIN_CELLS * self.hierarchy.edge(level)))

    def near(self, x: Floats, distance: Floats) -> Bools:
        """Which positions ``(n, d)`` may lie within a distance ``(n,)`` of a crack."""
        found = np.zeros(x.shape[0], dtype=np.bool_)
        for origin, dual, normal in zip(self.origin, self.dual, self.normal, strict=True):
            inside = np.abs((x - origin) @ normal) < distance
            t = (x - origin) @ dual.T
            margin = distance[:, None] * np.linalg.norm(dual, axis=1)
            found |= inside & ((t > -margin) & (t < 1.0 + margin)).all(axis=1)
        return found

    def nearest(self, x: Floats) -> Ints:
        """The crack to which each position ``(n, d)`` is nearest."""
        away = np.empty((x.shape[0], self.origin.shape[0]))
        for c, (origin, edges, dual) in enumerate(
            zip(self.origin, self.edges, self.dual, strict=True)
        ):
            foot = np.clip((x - origin) @ dual.T, 0.0, 1.0) @ edges
            away[:, c] = np.linalg.norm(x - origin - foot, axis=1)
        return np.argmin(away, axis=1)

    def height(self, crack: Ints, x: Floats) -> Floats:
        """Signed distance of each position from the plane of its crack."""
        return np.asarray(np.einsum("nd,nd->n", x - self.origin[crack], self.normal[crack]))

    def hidden(self, x: Floats, y: Floats) -> Bools:
        """Whether a crack crosses the line from each ``x`` to the nearest image of each ``y``."""
        out = np.zeros(x.shape[0], dtype=np.bool_)
        _hide(*self._arrays(), x, y, out)
        return out

    def cut_candidates(self, level: Int32s, x: Floats) -> Ints:
        """Points, by level and position on the grid, whose stencils a crack may cut."""
        limit = np.asarray(CUT_CELLS * self.hierarchy.cell / 2.0**level, dtype=np.float64)
        return np.flatnonzero(self.near(x, limit)).astype(np.int64)

    def fill_detours(
        self, mesh: Mesh, reference: Floats, x: Floats, candidates: Ints, stencils: Stencils
    ) -> None:
        """List the nodes of points near cracks, with the twin of a node that a crack hides.

        Parameters
        ----------
        reference, x : ndarray, shape ``(n, d)``
            Reference positions, which tell the side, and positions of the points on the grid.
        candidates : ndarray of int64, shape ``(m,)``
            Points whose stencils a crack may cut; point k has row k of ``stencils.detour``.
        """
        h, s = mesh.hierarchy, stencils
        place = (mesh.level, mesh.coords, np.asarray(h.low, dtype=float), h.cell)
        _fill_detours(
            *self._arrays(), *place, mesh.twin, reference, x, candidates, s.base, s.block,
            s.strides, s.detour,
        )  # fmt: skip

    def _arrays(self) -> tuple[Floats, Floats, Floats, Floats, float]:
        h = self.hierarchy
        return self.origin, self.dual, self.normal, h.period, ON_CRACK * h.cell


def make_cracks(
    cracks: Sequence[tuple[tuple[float, ...], ...]],
    hierarchy: Hierarchy,
    friction: float | None = None,
) -> Cracks | None:
    """Cracks of a body, or None if there are none.

    Parameters
    ----------
    cracks : sequence
        ``(from, to)`` in two dimensions; ``(from, to, along)`` in three: the parallelogram that
        the line from ``from`` to ``to`` covers when shifted by ``along``.
    friction : float, optional
        Coulomb's coefficient of faces in contact, 0 for smooth faces. If left out, faces may
        overlap.
    """
    if not cracks:
        return None
    flat = [
        (np.array(start, dtype=float), [np.subtract(end, start), *map(np.array, along)])
        for start, end, *along in cracks
    ]
    rims = [rim for origin, edges in flat for rim in _rims(origin, edges)]
    joints = {rim for rim in rims if rims.count(rim) > 1}
    h, rows = hierarchy, []
    shifts = product(*([-1, 0, 1] if repeats else [0] for repeats in h.periodic))
    images = [h.period * np.array(shift) for shift in shifts]
    for origin, edges in flat:
        outer, inner = _carry_on(origin, edges, joints, h)
        rows += [(outer + image, inner) for image in images]
    E = np.array([edges for _, edges in rows])
    dual = np.linalg.pinv(E).transpose(0, 2, 1)
    if h.dim == 2:
        normal = np.stack([-E[:, 0, 1], E[:, 0, 0]], axis=1)
    else:
        normal = np.cross(E[:, 0], E[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Cracks(np.array([origin for origin, _ in rows]), E, dual, normal, h, friction)


Corners = frozenset[tuple[float, ...]]


def _rims(origin: Floats, edges: list[Floats]) -> list[Corners]:
    """Corners of the rims ``t_k = 0`` and ``t_k = 1`` of a crack, for each k in turn."""
    rims = []
    for k, edge in enumerate(edges):
        others = edges[:k] + edges[k + 1 :]
        for start in (origin, origin + edge):
            ends = [start, *(start + other for other in others)]
            rims.append(frozenset(tuple(np.round(end, 9).tolist()) for end in ends))
    return rims


def _carry_on(
    origin: Floats, edges: list[Floats], joints: set[Corners], hierarchy: Hierarchy
) -> tuple[Floats, list[Floats]]:
    """Where a crack lies on the grid.

    A rim on a face of the domain continues straight on, beyond all nodes and points. A tip, which
    is a rim that no other crack shares, is drawn back: if the node on it had a twin, the crack
    would be longer by a cell.
    """
    rims = _rims(origin, edges)
    start, out = origin.copy(), []
    for k, edge in enumerate(edges):
        unit = hierarchy.cell * edge / np.linalg.norm(edge)
        before, after = (_extension(rim, joints, hierarchy) for rim in rims[2 * k : 2 * k + 2])
        start = start - before * unit
        out.append(edge + (before + after) * unit)
    return start, out


def _extension(rim: Corners, joints: set[Corners], hierarchy: Hierarchy) -> float:
    corners = np.array(list(rim))
    for axis, repeats in enumerate(hierarchy.periodic):
        low = hierarchy.low[axis]
        for face in (low, low + hierarchy.cells[axis] * hierarchy.cell):
            if (np.abs(corners[:, axis] - face) < 1e-8 * hierarchy.cell).all():
                return 0.0 if repeats else EXTENSION
    return 0.0 if rim in joints else -TIP_GAP


@njit(inline="always")
def _crosses(
    c: int, origin: Floats, dual: Floats, normal: Floats, X: Floats, x: Floats, y: Floats, on: float
) -> bool:
    """Whether crack c separates a point at x, on the side of X, from a node at y."""
    a, b = 0.0, 0.0
    for d in range(x.size):
        a += normal[c, d] * (X[d] - origin[c, d])
        b += normal[c, d] * (y[d] - origin[c, d])
    if (a >= -on) == (b >= -on):
        return False
    a, b = abs(a), abs(b)
    share = a / (a + b)
    for k in range(dual.shape[1]):
        t = 0.0
        for d in range(x.size):
            t += dual[c, k, d] * ((1.0 - share) * x[d] + share * y[d] - origin[c, d])
        if not -1e-12 <= t <= 1.0 + 1e-12:
            return False
    return True


@njit(inline="always")
def _any_crosses(
    origin: Floats,
    dual: Floats,
    normal: Floats,
    period: Floats,
    on: float,
    X: Floats,
    x: Floats,
    y: Floats,
) -> bool:
    for d in range(x.size):
        if period[d] > 0.0:
            y[d] -= period[d] * np.round((y[d] - x[d]) / period[d])
    for c in range(origin.shape[0]):  # noqa: SIM110 - numba knows no any()
        if _crosses(c, origin, dual, normal, X, x, y, on):
            return True
    return False


@njit(inline="always")
def _reached(origin: Floats, normal: Floats, x: Floats, reach: float) -> bool:
    """Whether the plane of any crack comes within ``reach`` along each axis of a point."""
    for c in range(origin.shape[0]):
        height, width = 0.0, 0.0
        for d in range(x.size):
            height += normal[c, d] * (x[d] - origin[c, d])
            width += abs(normal[c, d])
        if abs(height) < reach * width:
            return True
    return False


@njit(cache=True)
def _hide(
    origin: Floats,
    dual: Floats,
    normal: Floats,
    period: Floats,
    on: float,
    x: Floats,
    y: Floats,
    out: Bools,
) -> None:
    for n in range(x.shape[0]):
        out[n] = _any_crosses(origin, dual, normal, period, on, x[n], x[n], y[n].copy())


@njit(cache=True)
def _fill_detours(
    origin: Floats,
    dual: Floats,
    normal: Floats,
    period: Floats,
    on: float,
    level: Ints,
    coords: Ints,
    low: Floats,
    cell: float,
    twin: Ints,
    reference: Floats,
    x: Floats,
    candidates: Ints,
    base: Int32s,
    block: Int32s,
    strides: Ints,
    detour: Ints,
) -> None:
    dim = x.shape[1]
    y = np.empty(dim)
    for row in range(candidates.size):
        p = candidates[row]
        if base[p] < 0:  # it has not moved since its detour was filled
            continue
        edge = cell / 2.0 ** level[base[p]]
        if not _reached(origin, normal, x[p], 1.5 * edge + on):
            continue
        cut = False
        for n in range(3**dim):
            i, rest = base[p], n
            for d in range(dim - 1, -1, -1):
                i += (rest % 3) * strides[block[p], d]
                rest //= 3
            detour[row, n] = i
            if twin[i] < 0:
                continue
            for d in range(dim):
                y[d] = low[d] + coords[i, d] * edge
            if _any_crosses(origin, dual, normal, period, on, reference[p], x[p], y):
                detour[row, n] = twin[i]
                cut = True
        if cut:
            base[p] = -1 - row
