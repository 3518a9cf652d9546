"""Initial state: packets are waves that travel one way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.initial_state import initial_state, velocity_gradient
from gimpmd_schemas.case.plan import make_plan

PACKET: dict[str, Any] = {"center": 60, "wavelength": 12, "strain": 2e-4}
X = np.stack(np.meshgrid(np.linspace(0, 120, 601), [3.0, 40.0], indexing="ij"), -1).reshape(-1, 2)
BELOW = [[0, 60], [0, 20]]
X_ACROSS = X[:, ::-1].copy()


def state(case: Case, x: Floats) -> tuple[Floats, Floats, Floats]:
    return initial_state(make_plan(case), x)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("polarization", ["P", "S"])
def test_a_packet_is_a_wave_that_travels_one_way(
    make: Callable[..., Case], axis: int, direction: int, polarization: str
) -> None:
    packet = PACKET | {"axis": axis, "direction": direction, "polarization": polarization}
    case = make(initial__packets=[packet])
    x = X if axis == 0 else X_ACROSS
    component = axis if polarization == "P" else 1 - axis
    u, v, gradient = state(case, x)
    c = wave_speed(case, "P" if polarization == "P" else "S")
    # d'Alembert: v = -direction c du/dx
    assert v[:, component] == pytest.approx(
        -direction * c * gradient[:, component, axis], abs=1e-12
    )
    # the gradient is the derivative of u: central differences, off by eps^2 u''' / 6
    eps = 1e-4
    step = np.eye(2)[axis] * eps
    ahead, behind = state(case, x + step)[0], state(case, x - step)[0]
    assert (ahead - behind)[:, component] / (2 * eps) == pytest.approx(
        gradient[:, component, axis], abs=1e-10
    )
    # nothing else moves
    assert (u[:, 1 - component] == 0.0).all()
    assert (v[:, 1 - component] == 0.0).all()
    others = gradient.copy()
    others[:, component, axis] = 0.0
    assert (others == 0.0).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_packets_in_three_dimensions(make: Callable[..., Case], axis: int) -> None:
    block = {"only": "continuum", "domain__box": [[0, 120]] * 3}
    x = np.random.default_rng(1).uniform(0, 120, (50, 3))
    for polarization, component in (("P", axis), ("S", (axis + 1) % 3)):
        packet = PACKET | {"axis": axis, "polarization": polarization}
        case = make(initial__packets=[packet], **block)
        u, v, gradient = state(case, x)
        c = wave_speed(case, "P" if polarization == "P" else "S")
        assert v[:, component] == pytest.approx(-c * gradient[:, component, axis], abs=1e-15)
        assert np.abs(u[:, component]).max() > 0
        assert (np.delete(u, component, axis=1) == 0.0).all()
        assert np.count_nonzero(gradient) == np.count_nonzero(gradient[:, component, axis])


def test_a_packet_travels_at_the_speed_of_its_axis(make: Callable[..., Case]) -> None:
    """C11 = 100, C22 = 49, rho = 1: P waves run at 10 along x and at 7 along y."""
    stiffness = [[100, 30, 0], [30, 49, 0], [0, 0, 25]]
    material = {"from": "stiffness", "density": 1, "stiffness": stiffness}
    for axis, speed in ((0, 10.0), (1, 7.0)):
        case = make(continuum__material=material, initial__packets=[PACKET | {"axis": axis}])
        _, v, gradient = state(case, X if axis == 0 else X_ACROSS)
        assert v[:, axis] == pytest.approx(-speed * gradient[:, axis, axis], abs=1e-15)


def test_velocity_fields_add_inside_their_boxes(make: Callable[..., Case]) -> None:
    fields = [
        {"velocity": [1, 0]},
        {"velocity": [0, 2], "box": [[10, 20], [0, 50]]},
        {"velocity": [5, 6], "gradient": [[0, -3], [3, 0]], "center": [12, 10], "box": BELOW},
        {"velocity": [0, 0], "gradient": [[1, 0], [0, 0]], "box": [[100, 101], [0, 80]]},
    ]
    case = make(initial__velocities=fields)
    x = np.array([[5.0, 40.0], [10.0, 40.0], [20.0, 40.0], [14.0, 11.0], [100.5, 79.0]])
    u, v, gradient = state(case, x)
    # at (14, 11): 1 + 5 - 3 (11 - 10) and 2 + 6 + 3 (14 - 12)
    assert v == pytest.approx(np.array([[1, 0], [1, 2], [1, 0], [3, 14], [101.5, 0]]))
    assert not u.any()
    assert not gradient.any()


def test_amplitude_and_width(make: Callable[..., Case]) -> None:
    _, _, gradient = state(make(initial__packets=[PACKET | {"cycles": 4}]), X)
    # the largest strain is the asked one, up to the slope of the envelope at a quarter wave
    assert np.abs(gradient).max() == pytest.approx(2e-4, rel=0.1)
    k = 2 * np.pi / 12
    envelope = state(
        make(initial__packets=[PACKET | {"cycles": 4}]), np.array([[60.0, 0.0], [84.0, 0.0]])
    )[0][:, 0]
    assert envelope[0] == pytest.approx(2e-4 / k)
    # half of it at half of the full width: 4 wavelengths of 12 across, 24 from the middle
    assert envelope[1] / envelope[0] == pytest.approx(0.5, rel=1e-3)


def test_packets_add_and_rest_is_rest(make: Callable[..., Case]) -> None:
    other = {"center": 30, "wavelength": 20, "strain": 1e-4, "polarization": "S"}
    both = state(make(initial__packets=[PACKET, other]), X)
    for total, one, two in zip(
        both,
        state(make(initial__packets=[PACKET]), X),
        state(make(initial__packets=[other]), X),
        strict=True,
    ):
        assert total == pytest.approx(one + two, abs=1e-18)
    assert all((part == 0.0).all() for part in state(make(), X))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("polarization", ["P", "S"])
def test_a_tilted_packet_is_a_pure_wave_that_travels_one_way(
    make: Callable[..., Case], axis: int, direction: int, polarization: str
) -> None:
    packet = PACKET | {"axis": axis, "direction": direction, "polarization": polarization}
    case = make(initial__packets=[packet | {"tilt": 25.0}])
    x = np.random.default_rng(5).uniform(30, 90, (200, 2))
    _, v, gradient = state(case, x)
    # the gradient is the derivative of u
    eps = 1e-4
    for along in range(2):
        step = np.eye(2)[along] * eps
        ahead, behind = state(case, x + step)[0], state(case, x - step)[0]
        assert (ahead - behind) / (2 * eps) == pytest.approx(gradient[:, :, along], abs=1e-10)
    # P waves turn nothing, S waves change no area
    none = (
        gradient[:, 0, 1] - gradient[:, 1, 0]
        if polarization == "P"
        else gradient[:, 0, 0] + gradient[:, 1, 1]
    )
    assert np.abs(none).max() < 1e-18
    # d'Alembert along the direction of travel, 25 degrees off the axis
    n = np.zeros(2)
    n[axis], n[1 - axis] = direction * np.cos(np.radians(25.0)), np.sin(np.radians(25.0))
    c = wave_speed(case, "P" if polarization == "P" else "S")
    assert v == pytest.approx(-c * gradient @ n, abs=1e-15)
    assert np.linalg.norm(gradient, axis=(1, 2)).max() == pytest.approx(2e-4, rel=0.1)


def test_a_tilted_packet_repeats_across(make: Callable[..., Case]) -> None:
    tilt = float(np.degrees(np.arcsin(12 / 80)))
    case = make(initial__packets=[PACKET | {"tilt": tilt}])
    for one, other in zip(state(case, X), state(case, X + np.array([0.0, 80.0])), strict=True):
        assert one == pytest.approx(other, abs=1e-15)


def test_a_uniform_stretch(make: Callable[..., Case]) -> None:
    G = [[1e-3, 2e-3], [-3e-3, 4e-3]]
    case = make(initial__stretch={"gradient": G, "center": [10, 20]})
    u, v, gradient = state(case, X)
    assert u == pytest.approx((X - np.array([10.0, 20.0])) @ np.array(G).T, abs=1e-15)
    assert (gradient == np.array(G)).all()
    assert not v.any()
    assert (state(make(initial__stretch={"gradient": G}), np.zeros((1, 2)))[0] == 0).all()


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_the_gradient_of_the_velocity_is_its_derivative(
    make: Callable[..., Case], tilt: float
) -> None:
    """Away from the edge of the box of a velocity field, where it jumps."""
    packet = PACKET | {"polarization": "S", "tilt": tilt}
    field = {"velocity": [0.01, 0.02], "box": BELOW, "gradient": [[0.1, 0.2], [-0.3, 0.4]]}
    case = make(initial__packets=[packet], initial__velocities=[field])
    found = velocity_gradient(make_plan(case), X)
    eps = 1e-3
    for axis, step in enumerate(eps * np.eye(2)):
        slope = (state(case, X + step)[1] - state(case, X - step)[1]) / (2 * eps)
        away = np.abs(X[:, 0] - 60.0) > 2 * eps
        away &= np.abs(X[:, 0]) > 2 * eps
        np.testing.assert_allclose(found[away, :, axis], slope[away], rtol=1e-6, atol=1e-9)
    assert np.abs(found[:, 1, 0]).max() > 1e-4
