"""GIMP against exact solutions of linear elastodynamics."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.setup import make_solver
from gimpmd_gimp.sweeps.threads import SMALL
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError


def energy(solver) -> float:
    """Kinetic plus strain energy, summed here anew: Hooke's law in plane strain."""
    p, law = solver.points, solver.law
    xx, yy, shear = p.strain.T
    strain = 0.5 * law.lame * (xx + yy) ** 2 + law.shear * (xx**2 + yy**2 + 0.5 * shear**2)
    return float(p.volume @ strain + 0.5 * p.mass @ (p.v**2).sum(axis=1))


def standing_wave(case, amplitude=1e-4, component=0):
    solver = make_solver(make_plan(case))
    k = 2.0 * np.pi / 32.0
    solver.points.v[:, component] = amplitude * np.sin(k * solver.points.reference[:, 0])
    return solver, k


def mean_energy(solver, steps: int) -> float:
    total = 0.0
    for _ in range(steps):
        solver.step()
        total += energy(solver)
    return total / steps


@pytest.mark.parametrize(("integrator", "bound"), [("usavg", 1e-6), ("musl", 1e-4)])
def test_standing_wave_keeps_its_energy_over_100_periods(build, integrator, bound):
    """PHYSICS: USAVG +2.9e-8 and MUSL -1.3e-5 over 100 periods of 32 cells at CFL 0.4."""
    solver, _ = standing_wave(build(continuum=_continuum(build, integrator=integrator)))
    period = 80
    first = mean_energy(solver, period)
    for _ in range(98 * period):
        solver.step()
    last = mean_energy(solver, period)
    assert abs(last / first - 1.0) < bound


def _continuum(build, **changes):
    data = msgspec.to_builtins(build().continuum)
    data.update(changes)
    return data


@pytest.mark.parametrize("component", [0, 1])
def test_wave_speed_is_the_one_of_gimp_theory(build, component):
    """Dispersion of FLIP with uGIMP weights: lambda = 32 h lags by 0.52 % (at CFL to zero)."""
    case = build(time={"end": 1.0, "md_timestep": 0.1, "md_steps": 1})
    solver, k = standing_wave(case, component=component)
    speed = wave_speed(case, "P" if component == 0 else "S")
    shape = np.sin(k * solver.points.reference[:, 0])
    signal = []
    while solver.time < 0.8 * 32.0 / speed:
        solver.step()
        signal.append(float(solver.points.v[:, component] @ shape))
    signal = np.array(signal)
    turn = np.flatnonzero(np.diff(np.sign(signal)) != 0)
    times = [(i + 1 + signal[i] / (signal[i] - signal[i + 1])) * solver.dt for i in turn]
    measured = (16.0 / speed) / (times[1] - times[0])
    assert measured - 1.0 == pytest.approx(-0.0052, abs=0.0005)


def test_second_order_in_space(build):
    """Displacement of a standing wave, error over one period halves twice per refinement."""
    errors = []
    for n in (16, 32, 64):
        h = 32.0 / n
        case = build(
            domain={"box": [[0.0, 32.0], [0.0, 2.0 * h]], "periodic": [True, True]},
            md={"region": [[0.0, 32.0], [0.0, 2.0 * h]], "input": "none.in"},
            grid={"cell": h},
            time={"end": 1.0, "md_timestep": 0.1 * h, "md_steps": 1},
        )
        solver, k = standing_wave(case)
        for _ in range(round(32.0 / solver.dt)):
            solver.step()
        exact = 1e-4 / k * np.sin(k * solver.points.reference[:, 0]) * np.sin(k * solver.time)
        u = solver.points.x[:, 0] - solver.points.reference[:, 0]
        errors.append(np.sqrt(np.mean((u - exact) ** 2)))
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (rates > 1.9).all(), f"errors {errors}, rates {rates}"


def test_same_bits_on_any_number_of_threads(build):
    states = []
    rows = {"box": [[0.0, 32.0], [0.0, 160.0]], "periodic": [True, True]}
    for threads in (1, 2, 3):
        continuum = _continuum(build, xpic={"every": 3}, threads=threads)
        solver, _ = standing_wave(build(domain=rows, continuum=continuum))
        assert solver.points.count > SMALL
        for _ in range(10):
            solver.step()
        states.append(solver.points)
    for other in states[1:]:
        assert (states[0].v == other.v).all()
        assert (states[0].strain == other.strain).all()


def test_xpic_takes_the_null_space_and_leaves_the_wave(build):
    solver, _ = standing_wave(build(continuum=_continuum(build, xpic={"order": 5, "every": 20})))
    noise = 1e-5 * np.where(np.arange(solver.points.count) % 4 < 2, 1.0, -1.0)
    solver.points.v[:, 0] += noise  # opposite on the two points of a cell: no grid sees it
    before = solver.null_space([ALL] * 6)
    wave = energy(solver) - 0.5 * 64.0 * 1e-5**2
    for _ in range(20):
        solver.step()
    after = solver.null_space([ALL] * 6)
    assert np.abs(after).max() < 0.05 * np.abs(before).max()
    assert energy(solver) == pytest.approx(wave, rel=2e-3)


def test_cpgimp_points_follow_the_stretch(build):
    case = build(
        domain={"box": [[0.0, 8.0], [0.0, 2.0]], "periodic": [False, True]},
        md={"region": [[0.0, 8.0], [0.0, 2.0]], "input": "none.in"},
        continuum=_continuum(build, interpolation="cpgimp"),
        boundary={
            "left": {"condition": "symmetry"},
            "right": {"condition": "velocity", "value": [0.01, None], "ramp": 10.0},
        },
    )
    solver = make_solver(make_plan(case))
    while solver.time < 45.0:
        solver.step()
    stretch = solver.points.F[:, 0, 0]
    assert stretch.mean() == pytest.approx(1.0 + 0.01 * (45.0 - 5.0) / 8.0, rel=5e-3)
    # the weights of a point are those of its stretched domain: it touches two nodes while they fit
    solver.refresh()
    s = solver.body.stencils
    width = 0.25 * stretch
    cells = solver.points.x[:, 0]
    r = cells - np.floor(cells + 0.5)
    left = np.clip(width - r, 0.0, 2.0 * width)
    assert s.g[:, 0] == pytest.approx(-left / (2.0 * width), abs=1e-12)


def test_unstable_step_ends_with_a_message_not_a_crash(build):
    solver, _ = standing_wave(
        build(
            domain={"box": [[0.0, 32.0], [0.0, 2.0]]},
            time={"end": 1.0, "md_timestep": 4.0, "md_steps": 1},
        ),
        amplitude=0.1,
    )
    solver.points.v[:, 0] += np.random.default_rng(1).normal(size=solver.points.count)

    def run():
        for _ in range(2000):
            solver.step()

    with pytest.raises(BackendError, match="left the background grid"):
        run()
