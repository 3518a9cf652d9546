"""Steps of the integrators against steps that are written out with dense matrices.

``S`` and ``G`` are the weights and their gradients. The formulas are those of the module's comments
(paper Eqs. 5, 7, 8, 16, 17), on a small body of Hooke's law under a body force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from tests.physics.gimp.bodies import UNIT, body
from tests.services.gimp.dense import disturb, hooke, weights_of

DT = 0.3


def pull(X: np.ndarray, time: float) -> np.ndarray:
    """A body force that changes in space and time."""
    return 0.1 * np.sin(X + 2.0 * time)


@dataclass
class Dense:
    """State of the points, and what the integrators do with it."""

    S: np.ndarray
    G: np.ndarray
    m: np.ndarray
    volume: np.ndarray
    X: np.ndarray
    x: np.ndarray
    v: np.ndarray
    F: np.ndarray

    def __post_init__(self) -> None:
        self.M = self.S.T @ self.m
        self.used = self.M > 1e-12

    def project(self) -> np.ndarray:
        """``V_i = sum_p S_ip m_p v_p / M_i``."""
        return self.over_mass(self.S.T @ (self.m[:, None] * self.v))

    def change(self, span: float, time: float) -> np.ndarray:
        """``dV_i = span (sum_p S_ip m_p b_p - sum_p V_p sigma_p . grad S_ip) / M_i``."""
        sigma = hooke(self.F, UNIT.lame, UNIT.shear)
        force = self.S.T @ (self.m[:, None] * pull(self.X, time))
        force -= np.einsum("p,pij,pnj->ni", self.volume, sigma, self.G)
        return self.over_mass(span * force)

    def over_mass(self, P: np.ndarray) -> np.ndarray:
        V = np.zeros_like(P)
        V[self.used] = P[self.used] / self.M[self.used, None]
        return V

    def deform(self, V: np.ndarray, dt: float) -> None:
        self.F += dt * np.einsum("ni,pnj->pij", V, self.G)

    def move(self, V: np.ndarray) -> None:
        self.x += DT * self.S @ V


def musl(s: Dense, time: float) -> None:
    span = 0.5 * DT if time == 0.0 else DT  # velocities are known at half steps
    s.v += s.S @ s.change(span, time)
    V = s.project()
    s.deform(V, DT)
    s.move(V)


def usl(s: Dense, time: float) -> None:
    dV = s.change(DT, time)
    V = s.project() + dV
    s.deform(V, DT)
    s.move(V)
    s.v += s.S @ dV


def usf(s: Dense, time: float) -> None:
    V = s.project()
    s.deform(V, DT)
    dV = s.change(DT, time)
    s.move(V + dV)
    s.v += s.S @ dV


def usavg(s: Dense, time: float) -> None:
    V = s.project()
    s.deform(V, 0.5 * DT)
    dV = s.change(DT, time + 0.5 * DT)
    s.move(V + 0.5 * dV)
    s.v += s.S @ dV
    s.deform(s.project(), 0.5 * DT)


DENSE: dict[str, Callable[[Dense, float], None]] = {
    "musl": musl,
    "usl": usl,
    "usf": usf,
    "usavg": usavg,
}


def test_every_integrator_is_tested_here() -> None:
    assert set(DENSE) == set(INTEGRATORS)


@pytest.mark.parametrize("configuration", ["current", "reference"])
@pytest.mark.parametrize("cells", [(6,), (4, 3), (2, 3, 2)], ids=["1-D", "2-D", "3-D"])
@pytest.mark.parametrize("integrator", DENSE)
def test_a_step_is_that_of_the_formulas(integrator, cells, configuration) -> None:
    method = Method(integrator, xpic_every=0, configuration=configuration)
    periodic = (False,) * len(cells)
    load = BodyForce(pull)
    solver = body(cells, method, DT, disturb, periodic=periodic, conditions=[load])
    for _ in range(4):
        p = solver.points
        dense = Dense(
            *weights_of(solver),
            *(array.copy() for array in (p.mass, p.volume, p.reference, p.x, p.v, p.F)),
        )
        DENSE[integrator](dense, solver.time)
        solver.step()
        assert solver.points is p  # in the same order: no point has drifted
        for name in ("x", "v", "F"):
            found, expected = getattr(p, name), getattr(dense, name)
            np.testing.assert_allclose(found, expected, atol=1e-14, err_msg=name)
    assert np.abs(p.x - p.reference).max() > 0.02
