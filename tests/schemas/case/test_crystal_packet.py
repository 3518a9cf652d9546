"""Tilted packets in crystals: every wave is a mode, and together they are one packet."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.crystal_packet import PlaneWaves, modes, plane_waves
from gimpmd_schemas.case.form import Case, Packet
from gimpmd_schemas.case.initial_state import initial_state, velocity_gradient
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.elasticity import isotropic
from tests.schemas.mechanics.test_elasticity import COPPER, tensor

DENSITY, SPAN = 8.9, (0.0, 160.0)
SQUARES = COPPER / DENSITY
FLAT = np.array([[100.0, 30.0, 4.0], [30.0, 80.0, -3.0], [4.0, -3.0, 25.0]])
"""Of a plane crystal without mirror lines."""


def tilted(**changes: Any) -> Packet:
    return Packet(**({"center": 70.0, "wavelength": 12.0, "strain": 2e-4, "tilt": 25.0} | changes))


@pytest.mark.parametrize("polarization", ["P", "S"])
@pytest.mark.parametrize(
    ("squares", "axis"), [(FLAT, 0), (FLAT, 1), *((SQUARES, k) for k in range(3))]
)
def test_every_wave_is_a_mode(squares: np.ndarray, axis: int, polarization: str) -> None:
    """``C_ijlm k_j k_m u_l = frequency^2 u_i``."""
    packet = tilted(axis=axis, polarization=polarization, direction=-1)
    waves = plane_waves(packet, squares, SPAN)
    force = np.einsum("ijlm,nj,nm,nl->ni", tensor(squares), waves.k, waves.k, waves.moved)
    expected = waves.frequency[:, None] ** 2 * waves.moved
    np.testing.assert_allclose(force, expected, atol=1e-12 * np.abs(expected).max())
    carrier = np.array(packet.travel(waves.k.shape[1])) * 2.0 * np.pi / 12.0
    np.testing.assert_allclose(waves.k[len(waves.k) // 2], carrier, atol=1e-14)
    others = np.delete(waves.k - carrier, axis, axis=1)
    assert np.abs(others).max() < 1e-14


def test_in_an_isotropic_body_modes_are_p_and_s() -> None:
    """C11 = 9, C44 = 4: motion along k at a speed of 3, or across it, turned to the left, of 2."""
    k = np.random.default_rng(0).normal(size=(20, 3)) * [1.0, 1.0, 0.0]
    length = np.linalg.norm(k, axis=1)
    frequency, moved = modes(tilted(polarization="P"), isotropic(1.0, 4.0, 3), k)
    np.testing.assert_allclose(frequency, 3.0 * length)
    np.testing.assert_allclose(moved, k / length[:, None], atol=1e-12)
    frequency, moved = modes(tilted(polarization="S"), isotropic(1.0, 4.0, 3), k)
    np.testing.assert_allclose(frequency, 2.0 * length)
    left = np.stack([-k[:, 1], k[:, 0], k[:, 2]], axis=1)
    np.testing.assert_allclose(moved, left / length[:, None], atol=1e-12)


@pytest.mark.parametrize("polarization", ["P", "S"])
def test_waves_add_up_to_one_packet(polarization: str) -> None:
    """With the amplitude and width that are asked for, and nothing elsewhere in the body."""
    packet = tilted(polarization=polarization, cycles=3.0)
    x = np.zeros((801, 3))
    x[:, 0] = np.linspace(*SPAN, 801)
    waves = plane_waves(packet, SQUARES, SPAN)
    one, other = (norms(waves, x + y * np.eye(3)[1]) for y in (0.0, 0.25 * period(packet)))
    envelope = (
        2e-4 / (2.0 * np.pi / 12.0) * np.exp(-((x[:, 0] - 70.0) ** 2) / (2 * (36 / 2.355) ** 2))
    )
    # the direction of the motion changes by up to a tenth over the waves of the packet
    np.testing.assert_allclose(np.hypot(one, other), envelope, atol=0.02 * envelope.max())
    assert np.hypot(one, other)[x[:, 0] > 150.0].max() < 1e-5 * envelope.max()


def norms(waves: PlaneWaves, x: np.ndarray) -> np.ndarray:
    """Lengths of the displacements."""
    return np.asarray(np.linalg.norm(waves.state(x)[0], axis=1))


def period(packet: Packet) -> float:
    """Of the packet along y."""
    return packet.wavelength / float(np.sin(np.radians(packet.tilt)))


@pytest.mark.parametrize("polarization", ["P", "S"])
def test_fields_are_derivatives_of_each_other(make: Callable[..., Case], polarization: str) -> None:
    packet = {"center": 60, "wavelength": 12, "strain": 2e-4, "tilt": 20.0, "axis": 1}
    case = make(
        only="continuum",
        domain__box=[[0, 120]] * 3,
        continuum__material={"from": "stiffness", "density": DENSITY, "stiffness": COPPER.tolist()},
        initial__packets=[packet | {"polarization": polarization}],
    )
    plan = make_plan(case)
    x = np.random.default_rng(3).uniform(30.0, 90.0, (40, 3))
    gradient, rate, eps = initial_state(plan, x)[2], velocity_gradient(plan, x), 1e-4
    for axis, step in enumerate(eps * np.eye(3)):
        ahead, behind = initial_state(plan, x + step), initial_state(plan, x - step)
        for place, slope in ((0, gradient), (1, rate)):
            found = (ahead[place] - behind[place]) / (2.0 * eps)
            np.testing.assert_allclose(found, slope[:, :, axis], atol=1e-6 * np.abs(slope).max())
    assert (initial_state(plan, x)[0][:, 0] == 0.0).all()  # the plane of y and z


def test_the_velocity_is_that_of_waves_along_their_vectors() -> None:
    """A little later each wave has moved on by ``frequency / |k|`` along its k."""
    packet = tilted(polarization="S", direction=-1)
    waves = plane_waves(packet, SQUARES, SPAN)
    x = np.random.default_rng(4).uniform(30.0, 90.0, (20, 3))
    eps, at = 1e-4, []
    for sign, (k, moved, frequency) in itertools.product(
        (1.0, -1.0), zip(waves.k, waves.moved, waves.frequency, strict=True)
    ):
        shift = sign * eps * frequency * k / (k @ k)
        at.append(sign * np.cos((x - shift - waves.center) @ k)[:, None] * moved)
    np.testing.assert_allclose(sum(at) / (2.0 * eps), waves.state(x)[1], atol=1e-10)
