"""The ideal atoms and the ideal continuum, against Hooke's law."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_coupler.check.peers import PULSE, Bonds, Ideal, Measured
from gimpmd_schemas.case.form import Planes, Sites
from gimpmd_schemas.case.interface_nodes import interface_nodes
from tests.services.coupler.check.strip import strip_plan


@pytest.mark.parametrize(("column", "row"), [(0, 0), (0, 1)], ids=["stretch", "shear"])
def test_the_forces_of_a_small_strain_are_those_of_hooke(column: int, row: int) -> None:
    """The atoms pull at the continuum on either side with the traction times the width."""
    plan, strain = strip_plan(), 1e-7
    gradient = np.zeros((2, 2))
    gradient[row, column] = strain
    nodes = interface_nodes(plan)
    force = Ideal(plan, "continuum", nodes).strained(gradient)(0)["force"]
    x = plan.background_grid().positions()[nodes, 0]
    (low, high), (bottom, top) = plan.domain.box
    material = plan.continuum.material
    modulus = material.lame + 2.0 * material.shear if row == 0 else material.shear
    expected = np.zeros(2)
    expected[row] = modulus * strain * (top - bottom)
    bound = 1e-4 * np.abs(expected).max()
    left = x < 0.5 * (low + high)
    np.testing.assert_allclose(force[left].sum(axis=0), expected, rtol=0, atol=bound)
    np.testing.assert_allclose(force[~left].sum(axis=0), -expected, rtol=0, atol=bound)


def test_rigid_rotation_leaves_the_bonds_without_force() -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    bonds = Bonds(strip_plan())
    assert bonds.count > 0
    force = bonds.forces(np.array([[c - 1.0, -s], [s, c - 1.0]]))
    np.testing.assert_allclose(force, 0.0, atol=1e-12)


def test_nodes_get_the_whole_force() -> None:
    plan = strip_plan()
    bonds = Bonds(plan)
    force = np.random.default_rng(1).normal(size=(bonds.count, 2))
    nodal = bonds.nodal(force, interface_nodes(plan))
    np.testing.assert_allclose(nodal.sum(axis=0), force.sum(axis=0))


@pytest.mark.parametrize(("role", "name"), [("md", "velocity"), ("continuum", "force")])
def test_a_pulse_begins_and_ends_with_zero(role: str, name: str) -> None:
    plan = strip_plan()
    pulse = Ideal(plan, role, interface_nodes(plan)).pulse
    fields = [pulse(step)[name] for step in range(PULSE + 3)]
    largest = max(np.abs(field).max() for field in fields)
    assert largest > 0.0
    for step in (0, PULSE, PULSE + 1, PULSE + 2):
        assert np.abs(fields[step]).max() < 1e-12 * largest


def test_measured_forces_grow_with_the_strain_and_turn_with_the_body() -> None:
    """Two nodes in space; the derivative in component m of the strain is (m + 1) at one of them."""
    nodes = (4, 9)
    force = np.zeros((7, 2, 3))
    force[0, 0, 0] = 5.0
    force[1:, 1] = np.arange(1.0, 7.0)[:, None]
    sites = Sites(
        vectors=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        origin=(0.0, 0.0, 0.0),
        basis=((0.0, 0.0, 0.0),),
        shift=b"",
        period=(1.0, 1.0, 1.0),
        layers=(1.0, 1.0, 1.0),
        second=(Planes(),),
        nodes=nodes,
        force=force.tobytes(),
        stress=b"",
    )
    asked, measured = np.array([2, 9, 4]), Measured(sites, 3)
    gradient = np.zeros((3, 3))
    gradient[1, 1], gradient[0, 2], gradient[2, 0] = 1e-3, 1e-4, 3e-4
    found = measured.strained(gradient, asked)
    np.testing.assert_allclose(found[0], 0.0)
    np.testing.assert_allclose(found[1], 2.0 * 1e-3 + 5.0 * 4e-4)  # yy, and xz with both shears
    np.testing.assert_allclose(found[2], [5.0, 0.0, 5.0 * 1e-4])  # turned by half the difference
    pushed = measured.pushed(np.array([0.0, 1.0, 2.0]), asked)
    np.testing.assert_allclose(pushed, [[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [5.0, 1.0, 2.0]])
