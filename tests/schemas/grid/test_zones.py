"""Zones: depth, the bands of nodes that are exchanged, and patches."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones, in_box, owners, patches


@st.composite
def layouts(draw: st.DrawFn) -> tuple[BackgroundGrid, Zones]:
    """A grid and zones in it: any faces may be interfaces, any axis periodic."""
    h = draw(st.sampled_from([1.0, 0.7, 4.0]))
    cells = (draw(st.integers(24, 40)), draw(st.integers(24, 40)))
    region, interfaces, periodic = [], [], []
    for n in cells:
        across = draw(st.booleans())
        low, high = (False, False) if across else draw(st.tuples(st.booleans(), st.booleans()))
        lo = draw(st.floats(2.0, 6.0)) * h if low else 0.0
        hi = (n - draw(st.floats(2.0, 6.0))) * h if high else n * h
        region.append((lo, hi))
        interfaces.append((low, high))
        periodic.append(across)
    zones = Zones(
        regions=(MdRegion((region[0], region[1]), (interfaces[0], interfaces[1])),),
        outer=draw(st.floats(0.5, 3.0)) * h,
        incommunicado=draw(st.floats(0.0, 2.0)) * h,
        inner=draw(st.floats(2.0, 4.0)) * h,
        filter=2.0 * h,
    )
    return BackgroundGrid((0.0, 0.0), h, cells, (periodic[0], periodic[1])), zones


def touched(grid: BackgroundGrid, x: np.ndarray, half_width: float) -> set[int]:
    """Canonical ids of all nodes that particles at ``x`` touch with a weight above zero."""
    ids: set[int] = set()
    images = grid.images()
    for point in x:
        (bx, *sx), (by, *sy) = (stencil(float(c) / grid.cell, half_width) for c in point)
        for i in range(3):
            for j in range(3):
                if sx[i] * sy[j] > 0.0:
                    ids.add(int(images[(bx + i + 2) * grid.shape[1] + by + j + 2]))
    return ids


def scattered(zones: Zones, low: float, high: float, seed: int) -> np.ndarray:
    """Random positions in the MD region at depths low to high."""
    (x0, x1), (y0, y1) = zones.regions[0].box
    x = np.random.default_rng(seed).uniform((x0, y0), (x1, y1), (400, 2))
    depth = zones.depth(x)
    return x[(depth >= low) & (depth <= high)]


def test_of_several_regions_depth_and_nodes_are_those_of_each() -> None:
    grid = BackgroundGrid((0.0, 0.0), 1.0, (60, 30), (False, False))
    left = MdRegion(((0.0, 20.0), (5.0, 25.0)), ((False, True), (True, True)))
    right = MdRegion(((30.0, 50.0), (4.0, 24.0)), ((True, True), (True, True)))
    widths = {"outer": 1.0, "incommunicado": 0.5, "inner": 3.0, "filter": 2.0}
    both, alone = Zones((left, right), **widths), [Zones((one,), **widths) for one in (left, right)]
    x = np.array([[3.0, 15.0], [40.0, 14.0], [20.5, 10.0], [29.0, 10.0], [25.0, 1.0]])
    assert both.depth(x).tolist() == [10.0, 10.0, -0.5, -1.0, -5.0]
    for nodes in (Zones.inner_nodes, Zones.outer_nodes):
        parts = [set(nodes(zones, grid).tolist()) for zones in alone]
        assert all(parts)
        assert not parts[0] & parts[1]
        assert set(nodes(both, grid).tolist()) == parts[0] | parts[1]


@given(layouts(), st.integers(0, 2**32 - 1), st.floats(0.05, 0.5))
def test_bands_hold_every_node_that_their_zone_touches(
    layout: tuple[BackgroundGrid, Zones], seed: int, half_width: float
) -> None:
    grid, zones = layout
    for band, low, high in (
        (zones.inner_nodes(grid), zones.handover, zones.innermost),
        (zones.outer_nodes(grid), 0.0, zones.outer),
    ):
        x = scattered(zones, low, high, seed)
        drift = np.random.default_rng(seed).uniform(-grid.cell, grid.cell, x.shape)
        inside = np.clip(x + drift, 0.0, np.array(grid.cells) * grid.cell)  # stay in the body
        assert touched(grid, x, half_width) <= set(band.tolist())
        assert touched(grid, inside, half_width) <= set(band.tolist())
        assert grid.canonical()[band].all()
        assert (np.diff(band) > 0).all()


@given(layouts(), st.integers(0, 2**32 - 1))
def test_depth_is_the_distance_to_the_nearest_interface(
    layout: tuple[BackgroundGrid, Zones], seed: int
) -> None:
    grid, zones = layout
    x = np.random.default_rng(seed).uniform(-5, 45, (50, 2))
    for point, depth in zip(x, zones.depth(x), strict=True):
        distances = [np.inf]
        for axis in range(2):
            for side, sign in ((0, 1.0), (1, -1.0)):
                if zones.regions[0].interfaces[axis][side]:
                    distances.append(sign * (point[axis] - zones.regions[0].box[axis][side]))
        assert depth == min(distances)
    d = zones.outer
    (x0, x1), (y0, y1) = zones.regions[0].within(d)
    deeper = (x > (x0, y0)).all(axis=1) & (x < (x1, y1)).all(axis=1)
    clear = np.abs(zones.depth(x) - d) > 1e-9 * grid.cell  # not on the edge itself
    assert (deeper == (zones.depth(x) > d))[clear].all()


def test_the_zones_follow_one_another() -> None:
    zones = Zones((MdRegion(((0, 20), (0, 20)), ((True, True), (True, True))),), 3.0, 1.0, 5.0, 4.0)
    assert (zones.handover, zones.innermost, zones.energy_plane) == (4.0, 9.0, 3.5)


spans = st.tuples(st.floats(-1e3, 1e3), st.floats(0.1, 1e3)).map(lambda p: (p[0], p[0] + p[1]))
cuts = st.sampled_from([2, 3]).flatmap(
    lambda dim: st.tuples(
        st.tuples(*[spans] * dim), st.tuples(*[st.integers(1, 7 if dim == 2 else 4)] * dim)
    )
)


@given(cuts, st.integers(0, 2**32 - 1))
def test_patches_tile_the_region(cut: tuple[Box, tuple[int, ...]], seed: int) -> None:
    region, counts = cut
    boxes = patches(region, counts)
    assert len(boxes) == np.prod(counts)
    low, high = zip(*region, strict=True)
    x = np.random.default_rng(seed).uniform(low, high, (200, len(region)))
    # and the places where round-off could go either way: the edges of the patches
    edges = np.array([[low for low, _ in box] for box in boxes])
    x = np.concatenate([x, edges])
    held = np.array([in_box(box, x) for box in boxes])
    assert (held.sum(axis=0) == 1).all()
    assert (owners(region, counts, x) == held.argmax(axis=0)).all()


def test_patches_are_in_C_order() -> None:
    region, counts = ((0.0, 4.0), (0.0, 2.0), (0.0, 3.0)), (2, 1, 3)
    boxes = patches(region, counts)
    assert boxes[0] == ((0.0, 2.0), (0.0, 2.0), (0.0, 1.0))
    assert boxes[1] == ((0.0, 2.0), (0.0, 2.0), (1.0, 2.0))
    assert boxes[3] == ((2.0, 4.0), (0.0, 2.0), (0.0, 1.0))
    x = np.array([[1.0, 1.0, 1.5], [9.0, -1.0, 9.0]])
    assert owners(region, counts, x).tolist() == [1, 5]


def test_zones_of_a_block() -> None:
    """A region in the middle of a block: depth and nodes against a search over all nodes."""
    grid = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (12, 12, 6), (False, False, True))
    box = ((8.0, 16.0), (0.0, 14.0), (0.0, 12.0))
    faces = ((True, True), (False, True), (False, False))
    zones = Zones((MdRegion(box, faces),), 1.0, 0.5, 1.5, 4.0)
    x = np.array([[10.0, 3.0, 5.0], [12.0, 13.0, 0.0], [7.0, 1.0, 1.0], [12.0, 15.0, 1.0]])
    assert zones.depth(x).tolist() == [2.0, 1.0, -1.0, -1.0]
    assert zones.regions[0].within(1.0) == ((9.0, 15.0), (-np.inf, 13.0), (-np.inf, np.inf))
    nodes = grid.positions()
    expected = [
        node
        for node in np.flatnonzero(grid.canonical())
        if -6.0 < zones.depth(nodes[node : node + 1])[0] - 0.0 < 1.0 + 6.0
        and all(lo - 6.0 < c < hi + 6.0 for c, (lo, hi) in zip(nodes[node], box, strict=True))
    ]
    assert zones.outer_nodes(grid).tolist() == expected


@given(layouts(), st.tuples(st.integers(1, 5), st.integers(1, 5)))
def test_every_node_has_one_owner(
    layout: tuple[BackgroundGrid, Zones], counts: tuple[int, int]
) -> None:
    grid, zones = layout
    ids = zones.inner_nodes(grid)
    rank = owners(zones.regions[0].box, counts, grid.positions()[ids])
    assert ((rank >= 0) & (rank < counts[0] * counts[1])).all()
    offered = np.concatenate([ids[rank == r] for r in range(counts[0] * counts[1])])
    assert sorted(offered.tolist()) == ids.tolist()


def test_positions_outside_go_to_the_nearest_patch() -> None:
    x = np.array([[-5.0, 1.0], [15.0, 1.0], [5.0, -3.0], [5.0, 99.0], [10.0, 4.0]])
    assert owners(((0, 10), (0, 4)), (2, 2), x).tolist() == [0, 2, 2, 3, 3]
