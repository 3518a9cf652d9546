"""Bodies that move through nested levels: points split and merge."""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.method import Method
from tests.physics.gimp.bodies import body, largest, step_all
from tests.physics.gimp.gates import Check, gate
from tests.physics.gimp.waves import moving_energy

SPEED = 0.1
"""Of the body, over its wave speed."""


def drift(d: int, n: int, method: Method, strain: float, wave: float, cfl: float = 0.4) -> Any:
    """Move a body by half of a domain of ``n`` cells, finer in its middle half.

    The body starts with a uniform strain along x, or in a standing wave as long as the domain.

    Returns
    -------
    mass, momentum, energy, noise : float
        Change of mass (a share), of momentum (a share), of the energy that one who moves with
        the body sees (a share, the largest at any time), and the largest departure of velocity
        and strain from those at the start.
    """
    middle = ((n // 2, n + n // 2),) * d

    def initial(p: MaterialPoints) -> None:
        p.v[:, 0] += SPEED + wave * np.sin(2 * np.pi / n * p.reference[:, 0])
        p.F[:, 0, 0] += strain

    solver = body((n,) * d, method, cfl, initial, finer=((middle,),))
    mass, momentum = solver.energies()[2:4]
    start, worst = moving_energy(solver, SPEED), 0.0
    steps = int(0.5 * n / SPEED / cfl)
    for k in range(steps):
        step_all(solver)
        if k % (steps // 16) == 0:
            worst = max(worst, abs(moving_energy(solver, SPEED) / start - 1.0))
    p, end = solver.points, solver.energies()
    expected = np.eye(d)
    expected[0, 0] += strain
    noise = max(largest(p.v - SPEED * np.eye(d)[0]), largest(p.F - expected))
    return abs(end[2] / mass - 1.0), abs(end[3] / momentum - 1.0), worst, noise


@gate("points that cross a level's rim")
def crossing_levels() -> list[Check]:
    """Forces of coarse and fine points that move are taken at different times.

    So they balance to first order in the time step alone.
    """
    checks = []
    for d, n in ((1, 32), (2, 16)):
        mass, momentum, energy, noise = drift(d, n, Method(xpic_every=0), 1e-6, 0.0)
        label = f"{d}-D, strained body through a level,"
        checks += [
            Check(f"{label} mass", mass, high=1e-13, source="exact"),
            Check(f"{label} momentum", momentum, high=1e-13, source="exact"),
            Check(f"{label} energy", energy, high=2e-3, source="measured .7e-3"),
            Check(
                f"{label} noise over strain",
                noise / 1e-6,
                high=0.15,
                source="v dt / h, first order",
            ),
        ]
    return checks


@gate("points that cross a level's rim, order in time", long=True)
def order_in_time() -> list[Check]:
    coarse, fine = (drift(1, 32, Method(xpic_every=0), 1e-6, 0.0, cfl)[3] for cfl in (0.4, 0.05))
    order = float(np.log2(coarse / fine) / 3.0)
    return [Check("1-D, noise, order in the time step", order, low=0.6, source="first order")]


@gate("wave in a body that crosses a level's rim", long=True)
def wave() -> list[Check]:
    errors = [drift(1, n, Method(), 0.0, 1e-6)[2] for n in (16, 32, 64)]
    labels = zip((16, 32, 64), errors, (1.2e-2, 4e-3, 2e-3), strict=True)
    checks = [
        Check(f"1-D, energy, {n} coarse cells to the wave", e, high=bound, source="measured, 1.3 x")
        for n, e, bound in labels
    ]
    order = float(np.log2(errors[0] / errors[-1]) / 2.0)
    return [*checks, Check("1-D, energy, order in the cell", order, low=1.0, source="first order")]


@gate("wave in a body that crosses a level's rim, 2-D and 3-D", long=True)
def wave_in_space() -> list[Check]:
    checks = []
    for d, n, bound in ((2, 32, 5e-3), (2, 64, 3e-3), (3, 16, 1.5e-2)):
        mass, momentum, energy, _ = drift(d, n, Method(), 0.0, 1e-6)
        label = f"{d}-D, {n} cells,"
        checks += [
            Check(f"{label} mass", mass, high=1e-13, source="exact"),
            Check(f"{label} momentum", momentum, high=1e-12, source="round-off of 1e4 steps"),
            Check(f"{label} energy", energy, high=bound, source="as in 1-D"),
        ]
    return checks
