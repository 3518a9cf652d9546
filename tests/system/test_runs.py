"""Whole runs: what they leave, that layouts agree, that bits repeat, also if started by hand."""

from __future__ import annotations

import shlex
import subprocess

import numpy as np
import pytest

from gimpmd_deploy.results.compare import compare
from gimpmd_deploy.results.run import Run
from tests.conftest import ROOT
from tests.ports import free_port
from tests.small_run import ByHand, check_same_bits

SHORT = {"time.end": 0.8, "output.interval": 0.8}
"""20 steps of 20 MD steps, before chaos has amplified the last bits."""


def by_site(run: Run, time: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the atoms, in the order of their lattice sites."""
    atoms = run.atoms(time)
    order = np.lexsort(atoms.reference.round(4).T)
    return atoms.position[order], atoms.velocity[order]


def ranks(patches: tuple[int, int]) -> dict[str, object]:
    """A short run whose atoms are divided into patches."""
    return SHORT | {"md.ranks": patches[0] * patches[1], "md.patches": list(patches)}


@pytest.fixture
def coupled(finished) -> Run:
    """The small case, long enough for its energy to mean something."""
    return finished({"time.end": 8.0})


def test_a_coupled_run_leaves_what_it_promises(coupled):
    for name in (
        "case.yaml",
        "plan.yaml",
        "run.h5",
        "fields/points.vtkhdf",
        "atoms/atoms.dump",
        "logs/coupler.log",
        "logs/md.log",
        "logs/gimp.log",
        "logs/log.lammps",
    ):
        assert (coupled.folder / name).stat().st_size > 0, name
    assert len(coupled.energies.time) == 201
    assert coupled.energies.time[-1] == pytest.approx(8.0)


def test_energy_balances_the_work_of_the_load(coupled):
    """The small body is coarse: the same balance as the example's acceptance, 0.006, doubled."""
    energy, work = coupled.energies.energy[-1], coupled.energies.external_work[-1]
    assert work > 0
    assert abs(energy - work) / work < 0.012


@pytest.mark.long
def test_work_of_a_face_that_both_sides_share_is_counted_once(finished):
    """The MD region reaches the loaded top face; both sides bear a part of the traction."""
    run = finished(
        {
            "md.region": [[0, 33], [29, 64]],
            "md.variables": {"crack_length": 12, "crack_plane": 46.5},
            "continuum.cracks": [],
            "time.end": 4.0,
        }
    )
    both = [side.external_work[-1] for side in run.energies.sides.values()]
    assert min(both) > 0.1 * sum(both)
    # the strip in question, 3 of 64, would be 5 % of the work
    assert run.energies.energy[-1] == pytest.approx(sum(both), rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("patches", [(2, 1), (1, 2), (2, 2)])
def test_patch_layouts_agree_to_round_off(finished, patches):
    one, many = finished(ranks((1, 1))), finished(ranks(patches))
    # forces are sums of 18 neighbours in another order: 1e-15 each, over 400 MD steps; the dump
    # has nine digits
    for values, expected in zip(by_site(many), by_site(one), strict=True):
        assert values == pytest.approx(expected, abs=1e-7)
    assert many.points().position == pytest.approx(one.points().position, abs=1e-10)
    for role, side in one.energies.sides.items():
        for name in ("potential", "kinetic"):
            found = getattr(many.energies.sides[role], name)
            assert found == pytest.approx(getattr(side, name), rel=1e-8, abs=1e-9), (role, name)


@pytest.mark.parametrize("side", ["md", pytest.param("continuum", marks=pytest.mark.long)])
def test_one_side_alone_runs_the_whole_domain(finished, side):
    run = finished({"time.end": 4.0}, "--only", side)
    assert run.energies.time[-1] == pytest.approx(4.0)
    energies = run.energies.sides[side]
    assert energies.energy[-1] == pytest.approx(energies.external_work[-1], rel=0.01)
    assert energies.mass[0] == pytest.approx(0.9317984 * 64 * 64, rel=0.03)
    assert (energies.mass == energies.mass[0]).all()


def test_a_coupled_run_compares_with_md_alone(coupled, finished):
    """The load has come to its full value, and its front has reached the middle of the body."""
    comparison = compare(coupled, finished({"time.end": 4.0}, "--only", "md"))
    assert [row.time for row in comparison.differences] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    last = comparison.differences[-1]
    assert 0.0 < last.displacement_continuum < 0.1
    assert 0.0 < last.displacement_md < 0.5
    assert comparison.balance_b < 0.01


@pytest.mark.long
def test_units_metal_give_the_same_motion(command, case):
    """The same crystal in metal units: argon-like atoms, all lengths in units of sigma.

    Not relaxed before: where the minimizer stops is a matter of the last bits.
    """
    case["time"]["end"] = case["output"]["interval"] = 0.8
    case["md"]["minimize"] = False
    reduced = command.run(case, name="lj")
    mass, epsilon, mvv2e, nktv2p = 39.948, 0.0104, 1.0364269e-4, 1.6021765e6
    tau = (mass * mvv2e / epsilon) ** 0.5
    pressure = epsilon * nktv2p
    script = (command.folder / "crack.in").read_text()
    script = script.replace("units lj", "units metal").replace("mass * 1", f"mass * {mass}")
    script = script.replace("pair_coeff * * 1 1", f"pair_coeff * * {epsilon} 1.0")
    script = script.replace("lattice hex ${density}", "lattice hex ${a}")
    (command.folder / "crack.in").write_text(script)
    case["units"] = "metal"
    for key in ("end", "md_timestep"):
        case["time"][key] *= tau
    case["output"]["interval"] *= tau
    material = case["continuum"]["material"]
    material.update(
        density=material["density"] * mass,
        lame=material["lame"] * pressure,
        shear=material["shear"] * pressure,
    )
    for face in ("top", "bottom"):
        case["boundary"][face]["value"][1] *= pressure
        case["boundary"][face]["ramp"] *= tau
    metal = command.run(case, name="metal")
    # LAMMPS's constants mvv2e and nktv2p carry eight digits
    for values, expected, scale in zip(by_site(metal), by_site(reduced), (1.0, tau), strict=True):
        assert values * scale == pytest.approx(expected, abs=1e-6)
    assert metal.points().position == pytest.approx(reduced.points().position, abs=1e-6)
    energy = metal.energies.continuum.kinetic[-1] / epsilon
    assert energy == pytest.approx(reduced.energies.continuum.kinetic[-1], rel=1e-5)


@pytest.mark.parametrize("tls", [True, pytest.param(False, marks=pytest.mark.long)])
def test_the_bits_are_those_of_gimpmd_run(command, case, coupled, tls: bool) -> None:
    case["time"]["end"] = 1.0
    options = ["--listen", f"localhost:{free_port()}"] if tls else []
    started = ByHand(command.write(case), command.folder / "prepared", *options)
    assert "password" not in started.text
    for secret in (started.out / "keys").glob("*.password"):
        assert secret.read_text().strip() not in started.text
    assert shlex.quote(str(started.out)) in started.text
    with started:
        check_same_bits(started.finished(), coupled, (1.0,))


def test_the_compose_file_gives_the_same_bits_without_containers(command, case, coupled) -> None:
    case["time"]["end"] = 1.0
    out = command.folder / "up"
    file = ROOT / "deploy" / "compose.yaml"
    words = command.arguments("up", str(command.write(case)), "--file", str(file))
    done = subprocess.run([*words, "--out", str(out)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "coupler | " in done.stdout
    check_same_bits(Run(out), coupled, (1.0,))
