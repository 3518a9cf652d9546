"""Nested levels: what a wave that crosses an interface loses, reflects and scatters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_gimp.sweeps import kernels
from tests.physics.gimp.bodies import SHEAR_SPEED, body, largest, step_all, total_energy
from tests.physics.gimp.gates import Check, gate

CFL = 0.4
REFLECTED = {32: 2e-5, 16: 1.8e-4, 10: 1.3e-3}
"""Energy that an interface may reflect, by coarse cells per wavelength (acceptance)."""

FIELD = Method(xpic_every=0)
CORRECTED = Method("musl", configuration="reference", dispersion=correction(0.25))


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
        """Set velocity and displacement gradient of the points.

        At normal incidence strain and velocity are the packet. At an angle the displacement is
        the gradient of a packet, or its curl, so that no part is of the other polarization.
        """
        width, k = self.width * self.wavelength, 2 * np.pi / self.wavelength
        n = np.pad(self.direction, (0, 1))[: p.dim]
        X = p.reference - np.eye(p.dim)[0] * x0
        s = X[:, 0] / width
        if self.degrees == 0.0:
            a = n[::-1] if self.shear else n
            f = amplitude * np.exp(-0.5 * s**2) * np.cos(k * X[:, 0])
            p.F[:] += f[:, None, None] * np.outer(a, n)
            p.v[:] -= self.speed * f[:, None] * a
            return
        gauss = amplitude / k**2 * np.exp(-0.5 * s**2)
        slope, bend = -s / width * gauss, (s**2 - 1.0) / width**2 * gauss
        cosine, sine = np.cos(k * (X @ n)), np.sin(k * (X @ n))
        H = -(k**2) * (gauss * cosine)[:, None, None] * np.outer(n, n)  # of the potential
        H[:, 0, 0] += bend * cosine
        H[:, 0] -= k * (slope * sine)[:, None] * n
        H[:, :, 0] -= k * (slope * sine)[:, None] * n
        if self.shear:
            H = np.array([[0.0, 1.0], [-1.0, 0.0]]) @ H
        p.F[:] += H
        p.v[:] -= self.speed * H @ n


def run(
    packet: Packet,
    cells: tuple[int, ...],
    finer: tuple[Any, ...],
    start: float,
    distance: float,
    method: Method = FIELD,
    cell: float = 1.0,
) -> Solver:
    """Send a packet on its way over a distance along x; domains repeat along y and z."""
    solver = body(
        cells,
        method,
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
    one.law.energy(np.arange(here.size), 0, here.size, dF + np.eye(p.dim), p.history[here], density)
    return float(0.5 * np.sum(p.mass[here, None] * dv**2) + np.sum(p.volume[here] * density))


def scattered_back(
    packet: Packet,
    cells: tuple[int, ...],
    finer: tuple[Any, ...],
    rim: float,
    reach: float,
    method: Method = FIELD,
) -> float:
    """Energy that finer levels beyond a rim send back, as a share of the packet's.

    The field on the near side, once the packet has left it, less that of the same packet on a
    grid that goes on unchanged; what has not left yet cancels. The packet starts and ends at a
    distance ``reach`` from the rim. If it travels backwards the near side is the fine one.
    """
    start, distance = rim - packet.travel * reach, 2.0 * reach
    with_levels = run(packet, cells, finer, start, distance, method)
    if packet.travel > 0:
        without = run(packet, cells, (), start, distance, method)
    else:
        without = run(packet, tuple(2 * n for n in cells), (), start, distance, method, 0.5)
    before = run(packet, cells, (), start, 0.0)
    back = energy_of_difference(
        with_levels, without, lambda X: packet.travel * (X[:, 0] - rim) < 0.0
    )
    return back / total_energy(before)


def reflected(packet: Packet, levels: int = 2, method: Method = FIELD) -> float:
    """Energy that an interface across x sends back.

    The packet starts and ends three widths off the interface and three off the end behind it;
    the far end is so far away that no P wave comes back from it in time. A third level follows
    after 20 cells.
    """
    reach = 2 * int(np.ceil(1.5 * packet.width * packet.wavelength))
    far = reach if not packet.shear else reach + 2 * (reach // 4)
    rim = 2 * reach if packet.travel > 0 else far
    length = 2 * reach + far
    height = round(packet.wavelength / packet.direction[1]) if packet.degrees else 0
    cells = (length, height) if height else (length,)
    along_y = [((0, 2**k * height),) if height else () for k in range(levels)]
    finer = tuple(
        (((2**k * (rim + 20 * (k - 1)), 2**k * length), *along_y[k]),) for k in range(1, levels)
    )
    return scattered_back(packet, cells, finer, rim, reach, method)


@gate("level interface, 1-D", long=True)
def interface() -> list[Check]:
    checks = []
    for n, bound in REFLECTED.items():
        for label, packet, levels, factor in (
            ("into finer", Packet(n), 2, 1.0),
            ("out of finer", Packet(n, travel=-1), 2, 1.2),
            ("three levels", Packet(n), 3, 1.2),
        ):
            got = reflected(packet, levels)
            source = "prototype" if factor == 1.0 else "1.2 x prototype, one interface"
            checks.append(
                Check(f"reflected, {label}, {n} cells", got, high=factor * bound, source=source)
            )
    return checks


@gate("level interface, corrected dispersion", long=True)
def corrected_interface() -> list[Check]:
    """The correction goes on across rims, and with it goes most of what they reflect."""
    checks = []
    for n, bound in REFLECTED.items():
        for label, packet, levels in (
            ("into finer", Packet(n), 2),
            ("out of finer", Packet(n, travel=-1), 2),
            ("three levels", Packet(n), 3),
        ):
            got = reflected(packet, levels, CORRECTED)
            what = f"reflected, {label}, {n} cells"
            checks.append(Check(what, got, high=0.2 * bound, source="0.2 x prototype, lumped"))
    return checks


@gate("level interface, corrected dispersion, 2-D, oblique", long=True)
def corrected_oblique() -> list[Check]:
    checks = []
    for shear in (False, True):
        got = reflected(Packet(16.0, degrees=30.0, shear=shear), method=CORRECTED)
        what = f"reflected, {'S' if shear else 'P'}, 30 degrees, 16 cells"
        checks.append(Check(what, got, high=REFLECTED[16], source="prototype, lumped, normal"))
    return checks


@gate("level interface, 2-D, oblique", long=True)
def oblique() -> list[Check]:
    checks = []
    for degrees, height in ((30.0, 32), (45.0, 24)):
        wavelength = height * np.sin(np.radians(degrees))
        bound = 2.0 * REFLECTED[16] * (16.0 / wavelength) ** 4
        for shear in (False, True):
            got = reflected(Packet(wavelength, degrees=degrees, shear=shear))
            label = (
                f"reflected, {'S' if shear else 'P'}, {degrees:.0f} degrees, {wavelength:.0f} cells"
            )
            checks.append(Check(label, got, high=bound, source="2 x prototype, normal incidence"))
    return checks


@gate("corners of a level, 2-D", long=True)
def corner() -> list[Check]:
    """A box inside the plane that half of the wave front meets."""
    n = 16
    reach = 4 * n
    cells, rim = (3 * reach + 48, 48), 2 * reach
    box = ((2 * rim, 2 * (rim + 24)), (24, 72))
    got = scattered_back(Packet(n), cells, ((box,),), rim, reach)
    return [
        Check(
            f"scattered back by a box, {n} cells",
            got,
            high=REFLECTED[n],
            source="prototype, a whole interface",
        )
    ]


def worst_energy(width: float, trips: int, integrator: str = "usavg") -> tuple[float, float]:
    """Change of energy at the end of some round trips, and the largest, of a strain pulse.

    A bar of 200 coarse cells with fixed ends, finer in its right half.
    """

    def initial(p: MaterialPoints) -> None:
        f = 1e-8 * np.exp(-0.5 * ((p.reference[:, 0] - 50.0) / width) ** 2)
        p.F[:, 0, 0] += f
        p.v[:, 0] = -f

    ends = [PrescribedVelocity(0, side, 0, lambda t: 0.0) for side in (0, 1)]
    method = Method(integrator, xpic_every=0)  # type: ignore[arg-type]
    solver = body(
        (200,), method, CFL, initial, periodic=(False,), finer=((((200, 400),),),), conditions=ends
    )
    start, change = total_energy(solver), [0.0]
    for n in range(int(trips * 400 / CFL)):
        step_all(solver)
        if n % 50 == 49:
            change.append(total_energy(solver) / start - 1.0)
    return abs(change[-1]), largest(np.array(change))


def trip_checks(widths: tuple[float, ...], trips: int) -> list[Check]:
    checks = []
    for width in widths:
        last, worst = worst_energy(width, trips)
        label = f"pulse {width:g} cells wide, {trips} round trips"
        checks.append(
            Check(
                f"{label}, energy at any time", worst, high=7.5e-4, source="prototype, sub-stepping"
            )
        )
        checks.append(
            Check(f"{label}, energy at the end", last, high=4e-4, source="prototype: no growth")
        )
    return checks


@gate("level interface, energy over two round trips", long=True)
def few_trips() -> list[Check]:
    return trip_checks((4.0,), 2)


@gate("level interface, energy over 20 round trips", long=True)
def many_trips() -> list[Check]:
    return trip_checks((8.0, 4.0, 2.0), 20)


def nested(d: int) -> tuple[tuple[int, ...], tuple[Any, ...]]:
    """Cells of a domain, and levels with corners inside it: three in the plane, two in space."""
    if d == 1:
        return (48,), ((((24, 72),),), (((72, 120),),))
    if d == 2:
        return (32, 32), ((((16, 44), (18, 48)),), (((44, 76), (48, 76)),))
    return (16, 16, 16), ((((8, 22), (10, 24), (8, 24)),),)


def noise(p: MaterialPoints) -> None:
    """Reproducible random velocities and displacement gradients; a point's depend on its place."""
    for field in (p.v, p.F.reshape(p.count, -1)):
        for column in range(field.shape[1]):
            phase = p.reference @ np.array([12.9898, 78.233, 37.719])[: p.dim] + 3.1 * column
            field[:, column] += 1e-6 * (np.modf(43758.5453 * np.sin(phase))[0] + 0.1)


@gate("momentum and mass across levels", long=True)
def momentum() -> list[Check]:
    checks = []
    for d in (1, 2, 3):
        cells, finer = nested(d)
        for integrator in ("usavg", "musl"):
            solver = body(cells, Method(integrator), CFL, noise, finer=finer)  # type: ignore[arg-type]
            p = solver.points
            before, size = p.mass @ p.v, float(p.mass @ np.linalg.norm(p.v, axis=1))
            nodal = abs(solver.M[solver.mesh.basis].sum() / p.mass.sum() - 1.0)
            for _ in range(25):
                step_all(solver)
            p = solver.points
            change = largest(solver.energies()[3:] - before) / size
            checks.append(
                Check(
                    f"{d}-D, {integrator}, momentum, noise, 25 steps",
                    change,
                    high=1e-13,
                    source="exact",
                )
            )
        checks.append(
            Check(
                f"{d}-D, mass on nodes over mass of points - 1", nodal, high=1e-13, source="exact"
            )
        )
    return checks


@gate("patch test")
def patch() -> list[Check]:
    """Uniform strain over all levels of a domain that repeats: no force on any node."""
    checks = []
    for d in (1, 2, 3):
        cells, finer = nested(d)
        solver = body(cells, Method(), CFL, lambda p: None, finer=finer)
        p, mesh = solver.points, solver.mesh
        p.F[:] += 1e-3 * np.array([[1.0, 0.7, 0.2], [-0.3, -0.5, 0.4], [0.6, 0.1, 0.8]])[:d, :d]
        J, scale = np.zeros((mesh.size, d)), np.zeros((mesh.size, d))
        stress = solver.body.stress()
        arrays = (solver.body.stencils, 1.0, p.volume, stress)
        kernels.scatter_force(np.arange(p.count), 0, p.count, *arrays, J)
        mesh.constraints.restrict(J)
        every_other = np.arange(0, p.count, 2)
        kernels.scatter_force(every_other, 0, every_other.size, *arrays, scale)
        force = largest(J[mesh.basis]) / largest(scale)
        checks.append(
            Check(
                f"{d}-D, {len(finer) + 1} levels, force on any node",
                force,
                high=1e-13,
                source="exact",
            )
        )
    return checks


@gate("linear field over all levels")
def linear_field() -> list[Check]:
    """Points take a linear nodal field and its gradient, hanging nodes and corners included."""
    checks = []
    for d in (1, 2, 3):
        cells, finer = nested(d)
        solver = body(cells, Method(), CFL, lambda p: None, finer=finer, periodic=(False,) * d)
        p, mesh = solver.points, solver.mesh
        B = np.array([[1.0, 0.7, 0.2], [-0.3, -0.5, 0.4], [0.6, 0.1, 0.8]])[:d, :d] / 16.0
        solver.V[mesh.basis] = mesh.positions()[mesh.basis] @ B.T
        mesh.constraints.prolong(solver.V)
        v = np.zeros_like(p.v)
        solver.body.gather(ALL, solver.V, 1.0, v)
        L = solver.body.velocity_gradient(np.arange(p.count), solver.V)
        checks.append(
            Check(f"{d}-D, value at any point", largest(v - p.x @ B.T), high=1e-13, source="exact")
        )
        checks.append(
            Check(f"{d}-D, gradient at any point", largest(L - B), high=1e-13, source="exact")
        )
    return checks
