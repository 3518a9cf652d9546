"""Manufactured solutions at large strain (Wallstedt and Guilkey 2008; Steffen et al. 2008).

Young's modulus 1e4, density 1, bar speed c = 100, amplitude 0.05 of the unit length.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.laws import NeoHookean
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.method import Method
from tests.physics.gimp.bodies import body, largest
from tests.physics.gimp.gates import Check, gate, rates

E, C = 1e4, 100.0
PI = np.pi
LISTED = {8: 6.8e-3, 16: 1.34e-3, 32: 3.24e-4, 64: 8.0e-5, 128: 1.97e-5, 256: 4.9e-6}
"""Root mean square errors of the prototype, cpGIMP, amplitude 0.05."""
LISTED_2D = {8: 8.1e-3, 16: 1.91e-3, 32: 4.94e-4, 64: 1.3e-4, 128: 3.3e-5}
"""Largest errors of the prototype in the plane; at n = 128 a quarter of that at 64."""


def bar_error(n: int, method: Method, A: float = 0.05) -> float:
    """Largest in time of the root mean square error, over one period of a periodic bar.

    ``u = A sin(2 pi X) cos(c pi t)``, stress ``E/2 (F - 1/F)``, two points per cell, CFL 0.1.
    """

    def initial(p: MaterialPoints) -> None:
        p.x += A * np.sin(2 * PI * p.reference)
        p.F[:, 0, 0] += 2 * PI * A * np.cos(2 * PI * p.reference[:, 0])

    def force(X: np.ndarray, t: float) -> np.ndarray:
        u = A * np.sin(2 * PI * X) * np.cos(C * PI * t)
        F = 1.0 + 2 * PI * A * np.cos(2 * PI * X) * np.cos(C * PI * t)
        return (C * PI) ** 2 * u * (1.0 + 2.0 / F**2)

    steps = 20 * n
    solver = body(
        (n,),
        method,
        2.0 / C / steps,
        initial,
        cell=1 / n,
        law=NeoHookean.bar(1.0, E),
        conditions=[BodyForce(force)],
    )
    worst = 0.0
    for _ in range(steps):
        solver.step()
        p = solver.points
        exact = A * np.sin(2 * PI * p.reference) * np.cos(C * PI * solver.time)
        worst = max(worst, float(np.sqrt(np.mean((p.x - p.reference - exact) ** 2))))
    return worst


def rollers_error(d: int, n: int, method: Method, A: float = 0.05) -> float:
    """Largest error of any displacement component at any time, in the unit square or cube.

    ``u_k = A sin(pi X_k) sin(c pi t + phase_k)`` with phases 0, pi, 0; no component crosses its
    faces. Neo-Hookean, Poisson's ratio 0.3, ``2^d`` points per cell, CFL 0.2, one period.
    """
    law = NeoHookean(1.0, E * 0.3 / (1.3 * 0.4), E / 2.6)
    phase = np.array([0.0, PI, 0.0])[:d]

    def initial(p: MaterialPoints) -> None:
        p.v += A * C * PI * np.sin(PI * p.reference) * np.cos(phase)

    def force(X: np.ndarray, t: float) -> np.ndarray:
        u = A * np.sin(PI * X) * np.sin(C * PI * t + phase)
        F = 1.0 + A * PI * np.cos(PI * X) * np.sin(C * PI * t + phase)
        log_J = np.log(F.prod(axis=1))[:, None]
        stiff = (law.lame * (1.0 - log_J) + law.shear) / F**2 + law.shear
        return PI**2 * u * (stiff / law.density - C**2)

    driven = [PrescribedVelocity(k, side, k, lambda t: 0.0) for k in range(d) for side in (0, 1)]
    period = 2.0 / C
    steps = int(np.ceil(period * law.wave_speed() * n / 0.2))
    solver = body(
        (n,) * d,
        method,
        period / steps,
        initial,
        cell=1 / n,
        periodic=(False,) * d,
        law=law,
        conditions=[BodyForce(force), *driven],
    )
    worst = 0.0
    for _ in range(steps):
        solver.step()
        p = solver.points
        exact = A * np.sin(PI * p.reference) * np.sin(C * PI * solver.time + phase)
        worst = max(worst, largest(p.x - p.reference - exact))
    return worst


def bar(integrator: str, sizes: tuple[int, ...]) -> list[Check]:
    errors = [bar_error(n, Method(integrator, "cpgimp")) for n in sizes]  # type: ignore[arg-type]
    checks = [
        Check(
            f"1-D, {integrator}, cpGIMP, RMS, n = {n}",
            e,
            high=1.3 * LISTED[n],
            source="1.3 x prototype",
        )
        for n, e in zip(sizes, errors, strict=True)
    ]
    order = min(rates(errors))
    return [
        *checks,
        Check(
            f"1-D, {integrator}, order, n = {sizes[0]} to {sizes[-1]}",
            order,
            low=1.9,
            source="second order",
        ),
    ]


@gate("manufactured 1-D")
def short_bar() -> list[Check]:
    return [*bar("usavg", (8, 16, 32, 64)), *bar("musl", (8, 16, 32, 64))]


@gate("manufactured 1-D, fine", long=True)
def long_bar() -> list[Check]:
    """USAVG ends its order at n = 128; half the step restores it, XPIC in part. Why is open."""
    error = bar_error(256, Method("usavg", "cpgimp"))
    source = "1.5 x prototype; cause open"
    return [
        *bar("musl", (64, 128, 256)),
        *bar("usavg", (64, 128)),
        Check("1-D, usavg, cpGIMP, RMS, n = 256", error, high=1.5 * LISTED[256], source=source),
    ]


@gate("manufactured 1-D, weights that must fail at large strain")
def weights() -> list[Check]:
    """Points that keep their domain lose the partition of the body; hats jump at cell edges."""
    checks = []
    for name, interpolation, low, high in (
        ("uGIMP stalls", "ugimp", 4e-4, 2e-3),
        ("B-spline stalls", "bspline", 4e-4, 2e-3),
        ("hats err", "linear", 5e-3, np.inf),
    ):
        error = bar_error(64, Method("usavg", interpolation))  # type: ignore[arg-type]
        source = "expected to fail: cpGIMP has 8e-5"
        checks.append(Check(f"1-D, {name}, RMS, n = 64", error, low, high, source))
    return checks


@gate("manufactured 1-D, B-splines at small strain")
def splines() -> list[Check]:
    A = 1e-4
    errors = [bar_error(n, Method("usavg", "bspline"), A) for n in (8, 16, 32, 64)]
    return [
        Check(
            "1-D, B-spline, A = 1e-4, order, n = 8 to 64",
            min(rates(errors)),
            low=1.9,
            source="second order",
        )
    ]


def plane(integrator: str, sizes: tuple[int, ...], least: float = 1.9) -> list[Check]:
    method = Method(integrator, "cpgimp")  # type: ignore[arg-type]
    errors = [rollers_error(2, n, method) for n in sizes]
    checks = [
        Check(
            f"2-D, {integrator}, cpGIMP, largest, n = {n}",
            e,
            high=1.3 * LISTED_2D[n],
            source="1.3 x prototype" if n < 128 else "1.3 x extrapolated",
        )
        for n, e in zip(sizes, errors, strict=True)
    ]
    what = f"2-D, {integrator}, order, n = {sizes[0]} to {sizes[-1]}"
    return [*checks, Check(what, min(rates(errors)), low=least, source="second order")]


@gate("manufactured 2-D", long=True)
def short_plane() -> list[Check]:
    return plane("usavg", (8, 16, 32))


@gate("manufactured, reference configuration", long=True)
def reference() -> list[Check]:
    """Points that keep their domain: what stalls on the present body converges on that at rest."""
    checks = []
    for integrator in ("musl", "usavg"):
        method = Method(integrator, "ugimp", configuration="reference")  # type: ignore[arg-type]
        errors = {
            "1-D": [bar_error(n, method) for n in (8, 16, 32, 64)],
            "2-D": [rollers_error(2, n, method) for n in (8, 16, 32)],
        }
        for label, bounds in (("1-D", LISTED), ("2-D", LISTED_2D)):
            found = errors[label]
            n = 8 * 2 ** (len(found) - 1)
            what = f"{label}, {integrator}, uGIMP,"
            checks += [
                Check(f"{what} n = {n}", found[-1], high=bounds[n], source="cpGIMP's prototype"),
                Check(f"{what} order", min(rates(found)), low=1.9, source="second order"),
            ]
    return checks


@gate("manufactured 2-D, fine", long=True)
def long_plane() -> list[Check]:
    """USAVG falls short of second order at n = 128 (1.83), more often XPIC or not. Why is open."""
    return [
        *plane("usavg", (32, 64)),
        *plane("usavg", (64, 128), least=1.8),
        *plane("musl", (32, 64, 128)),
    ]


@gate("manufactured 3-D, reference configuration", long=True)
def reference_space() -> list[Check]:
    method = Method("musl", "ugimp", configuration="reference")
    errors = [rollers_error(3, n, method) for n in (8, 16)]
    return [Check("3-D, order, n = 8 to 16", *rates(errors), low=1.9, source="second order")]


@gate("manufactured 3-D", long=True)
def space() -> list[Check]:
    sizes = (8, 16, 32)
    errors = [rollers_error(3, n, Method("usavg", "cpgimp")) for n in sizes]
    checks = [
        Check(
            f"3-D, USAVG, cpGIMP, largest, n = {n}",
            e,
            high=1.5 * LISTED_2D[n],
            source="1.5 x plane",
        )
        for n, e in zip(sizes, errors, strict=True)
    ]
    return [
        *checks,
        Check("3-D, order, n = 8 to 32", min(rates(errors)), low=1.9, source="second order"),
    ]
