"""Initial state: packets are waves that travel one way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case import Case
from gimpmd_schemas.initial import initial_state

PACKET: dict[str, Any] = {"center": 60, "wavelength": 12, "strain": 2e-4}
X = np.stack(np.meshgrid(np.linspace(0, 120, 601), [3.0, 40.0], indexing="ij"), -1).reshape(-1, 2)
X_ACROSS = X[:, ::-1].copy()


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
    u, v, gradient = initial_state(case, x)
    c = case.wave_speed("P" if polarization == "P" else "S")
    # d'Alembert: v = -direction c du/dx
    assert v[:, component] == pytest.approx(
        -direction * c * gradient[:, component, axis], abs=1e-12
    )
    # the gradient is the derivative of u: central differences, off by eps^2 u''' / 6
    eps = 1e-4
    step = np.eye(2)[axis] * eps
    ahead, behind = initial_state(case, x + step)[0], initial_state(case, x - step)[0]
    assert (ahead - behind)[:, component] / (2 * eps) == pytest.approx(
        gradient[:, component, axis], abs=1e-10
    )
    # nothing else moves
    assert (u[:, 1 - component] == 0.0).all()
    assert (v[:, 1 - component] == 0.0).all()
    others = gradient.copy()
    others[:, component, axis] = 0.0
    assert (others == 0.0).all()


def test_amplitude_and_width(make: Callable[..., Case]) -> None:
    _, _, gradient = initial_state(make(initial__packets=[PACKET | {"cycles": 4}]), X)
    # the largest strain is the asked one, up to the slope of the envelope at a quarter wave
    assert np.abs(gradient).max() == pytest.approx(2e-4, rel=0.1)
    k = 2 * np.pi / 12
    envelope = initial_state(
        make(initial__packets=[PACKET | {"cycles": 4}]), np.array([[60.0, 0.0], [84.0, 0.0]])
    )[0][:, 0]
    assert envelope[0] == pytest.approx(2e-4 / k)
    # half of it at half of the full width: 4 wavelengths of 12 across, 24 from the middle
    assert envelope[1] / envelope[0] == pytest.approx(0.5, rel=1e-3)


def test_packets_add_and_rest_is_rest(make: Callable[..., Case]) -> None:
    other = {"center": 30, "wavelength": 20, "strain": 1e-4, "polarization": "S"}
    both = initial_state(make(initial__packets=[PACKET, other]), X)
    for total, one, two in zip(
        both,
        initial_state(make(initial__packets=[PACKET]), X),
        initial_state(make(initial__packets=[other]), X),
        strict=True,
    ):
        assert total == pytest.approx(one + two, abs=1e-18)
    assert all((part == 0.0).all() for part in initial_state(make(), X))
