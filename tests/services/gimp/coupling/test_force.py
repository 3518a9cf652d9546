"""The force scheme on the continuum's side alone: nodes pushed by given forces."""

from __future__ import annotations

import logging
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import Elastic, PairLattice
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.wire.energies import Energies
from tests.copper_sites import COPPER, slab_on_levels, strained, write_scripts
from tests.measuring import measured
from tests.physics.lattice import SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import ROWS, lj_crystal

H = 2.0 * SPACING

RIM = 5e-3
"""Share of a uniform strain that may be missing at the rim of a finer level."""


def case_of(levels: int) -> Case:
    """Continuum to the left of a plane midway between layers of atoms, levels around it."""
    length, height = 32 * H, 16 * H
    plane = float(48.5 * SPACING / 2 + 0.25 * SPACING)
    fine = [[8 * H, 32 * H], [0.0, height]]
    case = {
        "gimpmd": 1,
        "name": "pushed",
        "units": "lj",
        "domain": {"box": [[0.0, length], [0.0, height]]},
        "grid": {"cell": H * 2**levels, "levels": [{"boxes": [fine]}] * levels},
        "time": {"end": 1.0, "md_timestep": 0.002, "md_steps": 10},
        "md": {"region": [[plane - 3.0, length], [0.0, height]], "input": "none.in"},
        "continuum": {
            "material": {"from": "moduli", "density": 0.9318, "lame": 27.83316, "shear": 27.83316},
            "threads": 1,
        },
        "coupling": {
            "scheme": "force",
            "planes": {"left": plane},
        },
        "output": {"interval": 1.0},
    }
    made = msgspec.convert(case, Case)
    crystal = lj_crystal((0.25 * SPACING, 0.5 * ROWS))
    coupling = msgspec.structs.replace(made.coupling, crystal=crystal)
    return msgspec.structs.replace(made, coupling=coupling)


@pytest.fixture(params=[0, 1])
def side(request, tmp_path):
    (tmp_path / "fields").mkdir()
    made = side_of(case_of(request.param), tmp_path)
    yield made
    made.close()


def side_of(case: Case, folder: Path) -> ContinuumSide:
    """GIMP's side of a case."""
    plan = make_plan(case)
    return ContinuumSide(plan, Gimp(plan, None, folder))


def push(side: ContinuumSide, forces: list[np.ndarray]) -> list[Energies | None]:
    """Energies of all steps, the last of them at the stop."""
    energies = []
    for number, force in enumerate(forces):
        side.finish()
        side.receive({"force": force})
        if number < len(forces) - 1:
            side.advance()
        energies.append(side.energies())
    return energies


@pytest.mark.parametrize("levels", [0, 1])
def test_energies_are_those_of_the_times_that_all_levels_reach(levels, tmp_path) -> None:
    (tmp_path / "fields").mkdir()
    side = side_of(case_of(levels), tmp_path)
    rng = np.random.default_rng(2)
    shape = (side.needs.size, 2)
    energies = push(side, [1e-4 * rng.normal(size=shape) for _ in range(9)])
    side.close()
    for step, found in enumerate(energies):
        assert (found is not None) == (step % 2**levels == 0)


def test_energies_are_those_of_the_times_asked_for(tmp_path) -> None:
    """At other times there are none. At these times they do not depend on the interval."""
    (tmp_path / "fields").mkdir()
    often = case_of(0)
    output = msgspec.structs.replace(often.output, energy_interval=0.11)
    found = []
    for case in (often, msgspec.structs.replace(often, output=output)):
        made = side_of(case, tmp_path)
        force = np.full((made.needs.size, 2), 1e-3)
        found.append(push(made, [force] * 11))
        made.close()
    every_step, seldom = found
    assert seldom == [e if step % 5 == 0 else None for step, e in enumerate(every_step)]


def test_energy_is_the_work_of_the_atoms(side) -> None:
    """Rods pull at rest, since no atoms balance them; this is part of the potential energy."""
    force = np.zeros((side.needs.size, 2))
    force[:, 0] = -3.0
    steps = 40
    ramp = np.minimum(np.arange(steps + 1) / 20.0, 1.0)
    first, *_, last = push(side, [share * force for share in ramp])
    gained = last.kinetic + last.potential - first.kinetic - first.potential
    assert last.interface_work > 0.0
    assert gained == pytest.approx(last.interface_work, rel=1e-2)


def test_uniform_strain_is_held_on_levels_in_space(tmp_path) -> None:
    """Copper by the sites scheme; the atoms are replaced by the forces that LAMMPS measured.

    All that is left of first order is at the rims of the finer level, whose steps are shorter.
    """
    size, steps = 1e-5, 4
    (tmp_path / "fields").mkdir()
    write_scripts(tmp_path)
    case = measured(msgspec.convert(strained(slab_on_levels(0.32), size), Case), tmp_path)
    plan = make_plan(case)
    made = Gimp(plan, None, tmp_path)
    side = ContinuumSide(plan, made)
    G = np.array(case.initial.stretch.gradient)
    strain = np.array([G[i, j] + (G[j, i] if i != j else 0.0) for i, j in VOIGT[3]])
    sites = case.coupling.sites
    forces = np.frombuffer(sites.force).reshape(7, -1, 3)
    nodes = np.searchsorted(side.needs, sites.nodes)
    assert (side.needs[nodes] == sites.nodes).all()
    force = np.zeros((side.needs.size, 3))
    force[nodes] = forces[0] + np.tensordot(strain, forces[1:], axes=1)
    push(side, [force] * (steps + 1))
    points = made.solver.points
    off = np.abs(points.strain - strain).max(axis=1)
    side.close()
    beside = np.abs(points.reference[:, 0] / COPPER.cell - 17.0) < 6.0
    assert off[beside].max() < 30.0 * size**2
    assert off.max() < RIM * size


def test_velocities_at_the_start_are_those_of_rest(side) -> None:
    assert not side.zone_fields()["velocity"].any()


MU = 27.83316
CRYSTAL = lj_crystal((0.25 * SPACING, 0.5 * ROWS))
AS_IT_IS = Elastic(0.9318, MU, MU)
STIFFER = Elastic(0.9318, 1.5 * MU, MU)
SUMS = PairLattice(
    0.9318, MU, MU, SPACING * ROWS, CRYSTAL.bonds, CRYSTAL.energy, CRYSTAL.stretch_limit
)  # fmt: skip


@pytest.mark.parametrize(
    ("material", "level", "words"),
    [
        # as test_mismatch_of_a_law has it; half of lame's third of C11
        (AS_IT_IS, logging.INFO, ["linear", "off by 0.0 %", "1 % strain by up to 8.8 %"]),
        (STIFFER, logging.WARNING, ["off by 16.7 %", "model: cauchy-born"]),
        (SUMS, None, []),
    ],
)
def test_the_log_says_how_far_the_continuum_is_from_the_crystal(
    material, level, words, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "fields").mkdir()
    case = case_of(0)
    continuum = msgspec.structs.replace(case.continuum, material=material)
    caplog.set_level(logging.INFO, logger="gimpmd_gimp.coupling.force")
    side_of(msgspec.structs.replace(case, continuum=continuum), tmp_path).close()
    lines = [r for r in caplog.records if r.name == "gimpmd_gimp.coupling.force"]
    assert [line.levelno for line in lines] == ([] if level is None else [level])
    for line in lines:
        assert all(word in line.getMessage() for word in words), line.getMessage()
