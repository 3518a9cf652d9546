"""Whole runs: what they leave, that layouts agree, that bits repeat."""

from __future__ import annotations

import json
import subprocess

import h5py
import numpy as np
import pytest


def series(run):
    with h5py.File(run / "run.h5") as file:
        found = {}
        file["series"].visititems(
            lambda name, item: (
                found.update({name: item[:]}) if isinstance(item, h5py.Dataset) else None
            )
        )
    return found


def atoms(run):
    """Positions and velocities of the dump's last frame, in the order of lattice positions."""
    text = (run / "atoms" / "atoms.dump").read_text().split("ITEM: ATOMS ")[-1]
    header, *rows = text.strip().splitlines()
    columns = header.split()
    table = np.array([[float(word) for word in row.split()] for row in rows])
    lattice = [columns.index(name) for name in ("X0", "Y0")]
    table = table[np.lexsort(table[:, lattice].round(4).T)]
    return table[:, [columns.index(name) for name in ("x", "y", "vx", "vy")]]


def points(run):
    """Last positions of the material points."""
    with h5py.File(run / "fields" / "points.vtkhdf") as file:
        root = file["VTKHDF"]
        return root["Points"][-int(root["NumberOfPoints"][0]) :, :2]


def test_a_coupled_run_leaves_what_it_promises(command, case):
    run = command.run(case)
    for name in (
        "case.yaml",
        "run.h5",
        "fields/points.vtkhdf",
        "atoms/atoms.dump",
        "figures/sigma_yy.png",
        "figures/energies.png",
        "figures/wall_time.png",
        "logs/coupler.log",
        "logs/md.log",
        "logs/gimp.log",
        "logs/log.lammps",
    ):
        assert (run / name).stat().st_size > 0, name
    found = series(run)
    assert len(found["step"]) == 51
    assert found["time"][-1] == pytest.approx(2.0)
    report = subprocess.run(
        command.arguments("report", str(run), "--json"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert report.returncode == 0, report.stderr
    json.loads(report.stdout)


def test_energy_balances_the_work_of_the_load(command, case):
    """The small body is coarse: the same balance as the example's acceptance, 0.006, doubled."""
    case["time"]["end"] = 8.0
    found = series(command.run(case))
    energy = sum(
        found[f"{role}/{kind}"][-1]
        for role in ("md", "continuum")
        for kind in ("kinetic", "potential")
    )
    work = found["continuum/external_work"][-1] + found["md/external_work"][-1]
    assert work > 0
    assert abs(energy - work) / work < 0.012


def test_work_of_a_face_that_both_sides_share_is_booked_once(command, case):
    """The MD region reaches the loaded top face; both sides bear a part of the traction."""
    case["md"]["region"] = [[0, 33], [29, 64]]
    case["md"]["variables"] = {"crack_length": 12, "crack_plane": 46.5}
    case["continuum"]["cracks"] = []
    case["time"]["end"] = 4.0
    found = series(command.run(case))
    both = [found[f"{role}/external_work"][-1] for role in ("md", "continuum")]
    assert min(both) > 0.1 * sum(both)
    energy = sum(
        found[f"{role}/{kind}"][-1]
        for role in ("md", "continuum")
        for kind in ("kinetic", "potential")
    )
    # the strip in question, 3 of 64, would be 5 % of the work
    assert energy == pytest.approx(sum(both), rel=0.03)


@pytest.mark.parametrize("patches", [[2, 1], [1, 2], [2, 2]])
def test_patch_layouts_agree_to_round_off(command, case, patches):
    """20 steps of 20 MD steps, before chaos has amplified the last bits."""
    case["time"]["end"] = 0.8
    case["md"].update(ranks=1, patches=[1, 1])
    one = command.run(case, name="one")
    case["md"].update(ranks=patches[0] * patches[1], patches=patches)
    many = command.run(case, name="many")
    # forces are sums of 18 neighbours in another order: 1e-15 each, over 400 MD steps; the dump
    # has nine digits
    assert atoms(many) == pytest.approx(atoms(one), abs=1e-7)
    assert points(many) == pytest.approx(points(one), abs=1e-10)
    a, b = series(one), series(many)
    for name in ("md/potential", "md/kinetic", "continuum/kinetic", "continuum/potential"):
        assert b[name] == pytest.approx(a[name], rel=1e-8, abs=1e-9), name


def test_same_case_same_bits(command, case):
    case["time"]["end"] = 0.8
    first, second = (command.run(case, name=name) for name in ("first", "second"))
    assert (atoms(first) == atoms(second)).all()
    assert (points(first) == points(second)).all()


@pytest.mark.parametrize("side", ["md", "continuum"])
def test_one_side_alone_runs_the_whole_domain(command, case, side):
    run = command.run(case, "--only", side)
    found = series(run)
    assert found["time"][-1] == pytest.approx(2.0)
    balance = found[f"{side}/kinetic"][-1] + found[f"{side}/potential"][-1]
    assert balance == pytest.approx(found[f"{side}/external_work"][-1], rel=0.01)
    mass = found[f"{side}/mass"]
    assert mass[0] == pytest.approx(0.9317984 * 64 * 64, rel=0.03)
    assert (mass == mass[0]).all()


def test_a_coupled_run_compares_with_md_alone(command, case):
    case["time"]["end"] = 3.0
    coupled = command.run(case, name="coupled")
    alone = command.run(case, "--only", "md", name="alone")
    done = subprocess.run(
        command.arguments("compare", str(coupled), str(alone), "--json"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)


def test_units_metal_give_the_same_motion(command, case):
    """The same crystal in metal units: argon-like atoms, all lengths in units of sigma.

    Not relaxed before: where the minimizer stops is a matter of the last bits.
    """
    case["time"]["end"] = 0.8
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
    scale = np.array([1.0, 1.0, tau, tau])
    assert atoms(metal) * scale == pytest.approx(atoms(reduced), abs=1e-6)
    assert points(metal) == pytest.approx(points(reduced), abs=1e-6)
    energy = series(metal)["continuum/kinetic"][-1] / epsilon
    assert energy == pytest.approx(series(reduced)["continuum/kinetic"][-1], rel=1e-5)
