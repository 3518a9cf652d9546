"""Nested levels: what a wave that crosses an interface loses, reflects and scatters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimp.bodies import SHEAR_SPEED, body, largest, step_all, total_energy
from gimp.gates import Check, gate
from gimpmd_gimp.points import MaterialPoints
from gimpmd_gimp.solver import Scheme, Solver

CFL = 0.4
REFLECTED = {32: 2e-5, 16: 1.8e-4, 10: 1.3e-3}
"""Energy that an interface may reflect, by coarse cells per wavelength (PHYSICS 2)."""

FIELD = Scheme(xpic_every=0)


@dataclass(frozen=True)
class Packet:
    """A wave packet: a Gaussian along x, a plane wave at an angle to the x axis.

    Attributes
    ----------
    wavelength : in coarse cells.
    width : standard deviation of the Gaussian, in wavelengths.
    travel : along x, 1 or -1.
    degrees : angle of incidence; the wave repeats along y after ``period`` cells.
    shear : polarization across the direction of travel, instead of along it.
    """

    wavelength: float
    width: float = 1.5
    travel: int = 1
    degrees: float = 0.0
    shear: bool = False

    @property
    def direction(self) -> np.ndarray:
        angle = np.radians(self.degrees)
        return np.array([self.travel * np.cos(angle), np.sin(angle)])

    @property
    def speed(self) -> float:
        return SHEAR_SPEED if self.shear else 1.0

    def put(self, p: MaterialPoints, x0: float, amplitude: float = 1e-8) -> None:
        """Set velocity and strain of the points: ``u = a f(n . x - c t)``."""
        n = np.pad(self.direction, (0, 1))[: p.dim]
        n /= np.linalg.norm(n)
        a = np.array([-n[1], n[0]]) if self.shear else n
        X = p.reference - np.eye(p.dim)[0] * x0
        envelope = np.exp(-0.5 * (X[:, 0] / (self.width * self.wavelength)) ** 2)
        f = amplitude * envelope * np.cos(2 * np.pi / self.wavelength * (X @ n))
        p.F[:] += f[:, None, None] * np.outer(a, n)
        p.v[:] -= self.speed * f[:, None] * a


def run(
    packet: Packet,
    cells: tuple[int, ...],
    finer: tuple[Any, ...],
    start: float,
    distance: float,
    scheme: Scheme = FIELD,
    cell: float = 1.0,
) -> Solver:
    """Send a packet on its way over a distance along x; domains repeat along y and z."""
    solver = body(
        cells,
        scheme,
        CFL * cell,
        lambda p: packet.put(p, start),
        cell=cell,
        periodic=(False,) + (True,) * (len(cells) - 1),
        finer=finer,
    )
    speed = packet.speed * abs(packet.direction[0])
    for _ in range(int(distance / speed / CFL / cell)):
        step_all(solver)
    return solver


def energy_of_difference(
    one: Solver, other: Solver, where: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Energy of the difference of two fields on the points, in a region, that both have."""
    p, q = one.points, other.points
    here, there = np.flatnonzero(where(p.reference)), np.flatnonzero(where(q.reference))
    here, there = (
        rows[np.lexsort(points.reference[rows].T)] for rows, points in ((here, p), (there, q))
    )
    assert np.array_equal(p.reference[here], q.reference[there])
    dv, dF = p.v[here] - q.v[there], p.F[here] - q.F[there]
    density = np.zeros(here.size)
    one.law.energy(np.arange(here.size), 0, here.size, dF + np.eye(p.dim), density)
    return float(0.5 * np.sum(p.mass[here, None] * dv**2) + np.sum(p.volume[here] * density))


def reflected(packet: Packet, levels: int = 2, scheme: Scheme = FIELD) -> float:
    """Energy that an interface across x sends back, as a share of the packet's.

    The field on the near side, once the packet has left it, less that of the same packet on a
    grid that goes on unchanged; what has not left yet cancels. The packet starts and ends three
    widths off the interface and three off the end behind it. The grid is finer beyond, or
    coarser if the packet travels backwards; a third level follows after 20 cells.
    """
    reach = 2 * int(np.ceil(1.5 * packet.width * packet.wavelength))
    middle, length = (2 * reach if packet.travel > 0 else reach), 3 * reach
    height = round(packet.wavelength / packet.direction[1]) if packet.degrees else 0
    cells = (length, height) if height else (length,)
    along_y = [((0, 2**k * height),) if height else () for k in range(levels)]
    finer = tuple(
        (((2**k * (middle + 20 * (k - 1)), 2**k * length), *along_y[k]),) for k in range(1, levels)
    )
    start, distance = middle - packet.travel * reach, 2.0 * reach
    with_interface = run(packet, cells, finer, start, distance, scheme)
    if packet.travel > 0:
        without = run(packet, cells, (), start, distance, scheme)
    else:
        fine = tuple(2 * n for n in cells)
        without = run(packet, fine, (), start, distance, scheme, cell=0.5)
    before = run(packet, cells, (), start, 0.0, scheme)
    back = energy_of_difference(
        with_interface, without, lambda X: packet.travel * (X[:, 0] - middle) < 0.0
    )
    return back / total_energy(before)


def reflection_checks(
    packets: list[tuple[str, Packet, int, float]], source: str, scheme: Scheme = FIELD
) -> list[Check]:
    return [
        Check(f"reflected, {label}", reflected(packet, levels, scheme), high=bound, source=source)
        for label, packet, levels, bound in packets
    ]
