"""The toy MD code under `MdSide`: energies and loads, in the plane and in space, without LAMMPS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.roles import part_bit
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from tests.services.md.driving import advance_by, energies, having, total
from tests.services.md.toy_atoms import A, K, ToyAtoms

SIDE = 8.0 * A


def block(dim: int, **changes: Any) -> Plan:
    """A free cube or square of the toy's crystal, without a continuum."""
    density = {2: 2.0 / 3.0**0.5 / A**2, 3: 2.0**0.5 / A**3}[dim]
    shear = K if dim == 3 else 3.0**0.5 * K / 4.0  # of the order of the crystal's
    box = [[0.0, SIDE]] * dim
    case = {
        "gimpmd": 1,
        "name": "toy",
        "units": "lj",
        "domain": {"box": box, "periodic": [False] * dim},
        "grid": {"cell": SIDE / 4},
        "time": {"end": 4.0, "md_timestep": 0.005, "md_steps": 8},
        "md": {"region": box, "input": "none", "backend": "toy"},
        "continuum": {
            "material": {"from": "moduli", "density": density, "lame": shear, "shear": shear}
        },
        "output": {"interval": 4.0},
        "only": "md",
        **changes,
    }
    return make_plan(msgspec.convert(case, Case))


def start(plan: Plan) -> MdSide:
    side = MdSide(plan, ToyAtoms(plan, MPI.COMM_SELF, Path()))
    side.finish()
    return side


@pytest.mark.parametrize("dim", [2, 3])
def test_energy_and_momentum_are_conserved(dim: int) -> None:
    velocity = [0.3, -0.2, 0.1][:dim]
    gradient = (0.05 * np.random.default_rng(1).normal(size=(dim, dim))).tolist()
    side = start(block(dim, initial={"velocities": [{"velocity": velocity, "gradient": gradient}]}))
    first, at_start = energies(side), total(side)
    count = len(side.atoms.x)
    assert first.mass == count
    assert len(first.momentum) == dim
    np.testing.assert_allclose(first.momentum, side.atoms.v.sum(axis=0))
    advance_by(side, 40)
    assert energies(side).potential > 0.1
    np.testing.assert_allclose(energies(side).momentum, first.momentum, rtol=1e-11)
    assert total(side) == pytest.approx(at_start, rel=1e-3)


@pytest.mark.parametrize(("dim", "face"), [(2, "top"), (3, "top"), (3, "front")])
def test_the_impulse_of_a_traction_is_the_momentum(dim: int, face: str) -> None:
    axis = {"top": 1, "front": 2}[face]
    value = [0.05, -0.1, 0.2][:dim]
    side = start(block(dim, boundary={face: {"condition": "traction", "value": value}}))
    loaded = having(side, part_bit(0))
    x = side.atoms.site[:, axis]
    np.testing.assert_array_equal(loaded, x > x.max() - 0.1 * A)
    advance_by(side, 20)
    impulse = np.array(value) * SIDE ** (dim - 1) * 20 * 8 * 0.005
    np.testing.assert_allclose(energies(side).momentum, impulse, rtol=1e-10)
    assert total(side) == pytest.approx(energies(side).external_work, rel=2e-3)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_work_of_prescribed_velocities_is_the_energy(dim: int) -> None:
    """The last axis is stretched between a symmetric face and a moving one."""
    names = {2: ("bottom", "top"), 3: ("back", "front")}[dim]
    pull = [None] * (dim - 1) + [0.05]
    side = start(
        block(
            dim,
            boundary={
                names[0]: {"condition": "symmetry"},
                names[1]: {"condition": "velocity", "value": pull, "ramp": 1.0},
            },
        )
    )
    rest = side.atoms.x.copy()
    advance_by(side, 50)  # to t = 2
    moved = (side.atoms.x - rest)[:, -1]
    top = rest[:, -1] > rest[:, -1].max() - 1e-6
    np.testing.assert_allclose(moved[top], 0.05 * (2.0 - 0.5), atol=0.05 * 0.15)
    assert energies(side).external_work > 0.01
    assert total(side) == pytest.approx(energies(side).external_work, rel=5e-3)
