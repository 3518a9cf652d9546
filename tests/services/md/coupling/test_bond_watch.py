"""Broken bonds and overlaps near the planes: what makes them, and what must not."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import cKDTree

from gimpmd_md.coupling.bond_watch import BROKEN, BondWatch, NeighbourBonds
from gimpmd_md.roles import WATCHED
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.findings import Finding, worst
from tests.services.md.block import FORCE, A
from tests.services.md.driving import advance

CELLS = {
    "hex": ([1.0, 3**0.5], [[0, 0], [0.5, 0.5]]),
    "fcc": ([2**0.5] * 3, [[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]),
    "bcc": ([2 / 3**0.5] * 3, [[0, 0, 0], [0.5, 0.5, 0.5]]),
}
"""Edges of the cubic or rectangular cell, and places of its atoms; nearest neighbours at 1."""

SLIP = {
    "hex": ([0, 1], [1, 0]),
    "fcc": ([1, 1, 1], [2**0.5 / 6, 2**0.5 / 6, -(2**0.5) / 3]),  # Shockley partial
    "bcc": ([1, -1, 0], [1 / 3**0.5, 1 / 3**0.5, 1 / 3**0.5]),
}
"""Normal of the slip plane, and the shortest vector by which the crystal slips."""

FREE = np.zeros(3)


def crystal(name: str, count: int = 8) -> np.ndarray:
    """Atoms of ``count`` cells along each axis."""
    edges, basis = map(np.array, CELLS[name])
    corners = np.array(list(product(range(count), repeat=len(edges))))
    return (corners[:, None] + basis).reshape(-1, len(edges)) * edges


def look(rest: np.ndarray, x: np.ndarray, period: np.ndarray = FREE) -> dict[str, Finding]:
    """Findings by kind."""
    found = NeighbourBonds(MPI.COMM_SELF, period[: rest.shape[1]]).look(rest, x)
    return {finding.kind: finding for finding in found}


@pytest.fixture(params=CELLS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_slip_breaks_bonds_at_the_slip_plane(name: str) -> None:
    rest = crystal(name)
    normal, vector = (np.array(value, float) for value in SLIP[name])
    normal /= np.linalg.norm(normal)
    height = (rest - rest.mean(axis=0)) @ normal - 1e-3
    found = look(rest, rest + np.outer(height > 0.0, vector))
    assert found["broken bond"].value > 1.41
    assert found["overlap"].value > 1.41 or name == "bcc"  # second neighbours are bonded there
    for finding in found.values():
        assert abs((np.array(finding.place) - rest.mean(axis=0)) @ normal) < 0.75


def test_an_atom_that_jumps_into_a_vacancy_breaks_bonds(name: str) -> None:
    rest = crystal(name)
    middle = np.argmin(np.linalg.norm(rest - rest.mean(axis=0), axis=1))
    vacancy = rest[middle]
    rest = np.delete(rest, middle, axis=0)
    x = rest.copy()
    x[np.argmin(np.linalg.norm(rest - vacancy, axis=1))] = vacancy
    found = look(rest, x)["broken bond"]
    assert np.linalg.norm(np.array(found.place) - vacancy) < 1.5


def test_an_atom_between_others_overlaps(name: str) -> None:
    rest = crystal(name)
    middle, nearest = np.argsort(np.linalg.norm(rest - rest.mean(axis=0), axis=1))[:2]
    x = rest.copy()
    x[middle] += 0.21 * (rest[nearest] - rest[middle])
    assert look(rest, x)["overlap"].value > 1.25
    x[middle] = rest[middle] + 0.15 * (rest[nearest] - rest[middle])
    assert look(rest, x) == {}


def test_strain_and_rotation_break_none(name: str) -> None:
    rest = crystal(name)
    dim = rest.shape[1]
    stretch = np.eye(dim) * [1.1, 0.95, 0.95][:dim]
    stretch[0, 1] = 0.1
    c, s = np.cos(1.2), np.sin(1.2)
    turn = np.eye(dim)
    turn[:2, :2] = [[c, -s], [s, c]]
    assert look(rest, rest @ (turn @ stretch).T) == {}


def test_thermal_motion_at_a_tenth_of_the_melting_temperature_breaks_none(name: str) -> None:
    """By Lindemann's criterion atoms move by 0.1 spacings (rms) at the melting temperature."""
    rest = crystal(name, 12)
    dim = rest.shape[1]
    random = np.random.default_rng(1)
    bonds = NeighbourBonds(MPI.COMM_SELF, FREE[:dim])
    for _ in range(20):
        u = random.normal(0.0, 0.1 * np.sqrt(0.1 / dim), rest.shape)
        assert bonds.look(rest, rest + u) == ()
    u = random.normal(0.0, 0.1 * np.sqrt(2.0 / dim), rest.shape)  # far above melting
    assert len(bonds.look(rest, rest + u)) == 2


def test_periodic_faces_join_neighbours(name: str) -> None:
    rest = crystal(name)
    period = 8.0 * np.array(CELLS[name][0])
    shifted = rest + 0.3 * period + 1e-3  # a rigid motion across the faces
    assert look(rest, shifted % period, period) == {}
    assert "broken bond" in look(rest, shifted % period, 0.0 * period)
    inward = rest.copy()
    inward[:, 0] *= 0.6  # opens a gap at the periodic face
    assert "broken bond" in look(rest, inward, period)


@pytest.mark.parametrize("over", [1.0 - 1e-9, 1.0 + 1e-9])
def test_a_bond_breaks_at_the_limit(over: float) -> None:
    rest = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    x = rest * [BROKEN * over, 1.0]
    found = look(rest, x)
    assert list(found) == (["broken bond"] if over > 1.0 else [])
    for finding in found.values():
        assert finding.place == pytest.approx((0.5 * BROKEN, 0.0))


class Ranks:
    """What `NeighbourBonds` needs of mpi4py, for ranks that are threads."""

    def __init__(self, rank: int, values: list[Any], barrier: threading.Barrier) -> None:
        self.rank, self.size = rank, len(values)
        self._values, self._barrier = values, barrier

    def allgather(self, value: Any) -> list[Any]:
        self._values[self.rank] = value
        self._barrier.wait(10.0)
        gathered = list(self._values)
        self._barrier.wait(10.0)
        return gathered


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("along", [0, 1])
def test_ranks_find_the_same_together_as_one_alone(name: str, size: int, along: int) -> None:
    """Also if the slip plane is the boundary between two ranks, and after atoms change ranks."""
    rest = crystal(name)
    period = 8.0 * np.array(CELLS[name][0]) * (np.arange(rest.shape[1]) == 0)
    upper = rest[:, 1] > rest[:, 1].mean() + 1e-3
    x = rest.copy()
    x[upper, 1] += 0.4
    whole = list(look(rest, x, period).values())
    assert "broken bond" in [finding.kind for finding in whole]
    cut = np.digitize(rest[:, along], np.linspace(0.0, rest.max(), size + 1)[1:-1] + 1e-3)
    if size == 2 and along == 1:
        cut = upper.astype(int)
    values, barrier = [None] * size, threading.Barrier(size)
    found: list[list[Any]] = [[] for _ in range(size)]

    def work(rank: int) -> None:
        bonds = NeighbourBonds(Ranks(rank, values, barrier), period)
        for owner in (cut, (cut + 1) % size, np.arange(len(rest)) % size):
            mine = owner == rank
            found[rank].append(bonds.look(rest[mine], x[mine]))

    threads = [threading.Thread(target=work, args=(rank,)) for rank in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for parts in zip(*found, strict=True):
        together = worst(finding for part in parts for finding in part)
        for one, other in zip(together, whole, strict=True):
            assert (one.kind, one.value) == (other.kind, pytest.approx(other.value, rel=1e-12))


def test_a_rank_without_watched_atoms() -> None:
    assert look(np.zeros((0, 2)), np.zeros((0, 2))) == {}


WIDE: dict[str, Any] = {"domain__box": [[0, 78], [0, 52]], "md__region": [[13, 65], [13, 39]]}
"""A wider block, so that a dislocation can glide some way to the right."""

ROW = A * 3**0.5 / 2
MIDDLE = 26 * ROW
"""Height of a slip plane, midway between two rows of atoms and far from all planes."""


def wide_block(make: Callable[..., Case], scheme: str) -> Case:
    if scheme == "velocity":
        return make(**WIDE)
    return make(
        **WIDE, **FORCE | {"coupling__planes": FORCE["coupling__planes"] | {"right": 56 * A}}
    )


def edge_dislocation(x: np.ndarray, core: float) -> np.ndarray:
    """Displacement of an edge dislocation that slips everything to its left, at height `MIDDLE`.

    Isotropic elasticity (Hirth and Lothe, Theory of Dislocations, eq. 3-45), Poisson's ratio 1/4.
    """
    dx, dy = x[:, 0] - core, x[:, 1] - MIDDLE
    r2 = dx**2 + dy**2
    along = np.arctan2(dy, dx) + dx * dy / (1.5 * r2)
    up = -(0.5 / 3.0 * np.log(r2) + (dx**2 - dy**2) / (3.0 * r2))
    return A / (2.0 * np.pi) * np.column_stack([along, up])


def depth_of_defects(side: MdSide, box: np.ndarray) -> float:
    """Least depth in the box of the atoms that do not have six neighbours."""
    x = side.atoms.x
    neighbours = cKDTree(x).query_ball_point(x, 1.3 * A, return_length=True) - 1
    low, high = box
    odd = (neighbours != 6) & ((x > low) & (x < high)).all(axis=1)
    return float(np.minimum(x[odd] - low, high - x[odd]).min(initial=np.inf))


@pytest.mark.parametrize("scheme", ["force", pytest.param("velocity", marks=pytest.mark.long)])
def test_a_gliding_dislocation_is_found_when_it_comes_near_the_planes(
    start: Callable[[Case], MdSide], make: Callable[..., Case], scheme: str
) -> None:
    """A pair of dislocations under shear; where they are is found by counting neighbours."""
    case = wide_block(make, scheme)
    side = start(case)
    coupled, atoms = make_plan(case).coupled, side.atoms
    rest, outer = atoms.rest.copy(), coupled.zones.outer
    box = np.array([[13 + outer, 13 + outer], [65 - outer, 39 - outer]])
    if scheme == "force":
        box = np.array(coupled.interfaces[0].planes).T
    atoms.x[:] += edge_dislocation(rest, 50.0) - edge_dislocation(rest, 38.0)
    atoms.x[:, 0] += 0.05 * (rest[:, 1] - MIDDLE)
    depth = [np.inf]
    watch = BondWatch(make_plan(case), atoms)
    while not watch.look():
        depth.append(depth_of_defects(side, box))
        assert len(depth) < 100
        advance(side)
    reach = 2.0 * atoms.cutoff
    assert min(depth[:10]) > reach + A  # it had to glide there
    assert depth[-1] < reach + A
    assert min(depth[:-6], default=np.inf) > reach - A  # not six coupling steps ago
    x, y = watch.look()[0].place
    assert abs(y - MIDDLE) < A
    assert box[1, 0] - x < reach + A


@pytest.mark.parametrize("scheme", ["force", "velocity"])
def test_a_warm_block_has_no_broken_bonds(
    start: Callable[[Case], MdSide], make: Callable[..., Case], scheme: str
) -> None:
    """The crystal melts at about 0.4; half of the kinetic energy becomes potential energy."""
    case = wide_block(make, scheme)
    side = start(case)
    watch = BondWatch(make_plan(case), side.atoms)
    temperature = 0.1 * 0.4
    random = np.random.default_rng(2)
    side.atoms.v[:] = random.normal(0.0, np.sqrt(2.0 * temperature), side.atoms.v.shape)
    watched = (side.atoms.role & WATCHED) != 0
    assert 0.4 < watched.mean() < 0.9
    for _ in range(40):
        advance(side)
        assert watch.look() == ()
