"""The sites scheme in whole runs: strain that is held, waves, energy, ranks, a checkpoint."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_deploy.verify.crossing import crossing
from gimpmd_schemas.case.form import FACES
from tests.cases import on_patches
from tests.physics import embedded
from tests.physics.interface.absorbers import leaving
from tests.physics.interface.packets import nested
from tests.physics.strips import (
    H,
    Run,
    Wave,
    broadband_case,
    energies,
    run_case,
    run_in,
    strain_error,
    strip_case,
)
from tests.physics.test_regions import displacements, two_regions
from tests.sites_case import SCRIPT
from tests.system.conftest import Command
from tests.system.test_resume import check_same_bits, cut, resume

SITES = {"scheme": "sites"}
HELD = {"condition": "velocity", "value": [0.0, 0.0]}


def box(end: float) -> dict[str, Any]:
    """A box of atoms inside a plate, off the node lines, and waves of 4 to 10 cells."""
    case = broadband_case(end, md_steps=16, md_timestep=0.005, coupling=SITES)
    case["domain"] = {"box": [[0.0, 30 * H], [0.0, 22 * H]], "periodic": [False, False]}
    case["md"]["region"] = [[7.3 * H, 18.8 * H], [6.2 * H, 15.9 * H]]
    case["boundary"] = {}
    for packet in case["initial"]["packets"]:
        packet["tilt"] = 35.0
    return case


def strained(case: dict[str, Any], size: float) -> dict[str, Any]:
    """The case between held faces, at a uniform strain."""
    case["boundary"] = dict.fromkeys(FACES[:4], HELD)
    case["initial"] = {"stretch": {"gradient": [[size, 0.5 * size], [0.0, -0.5 * size]]}}
    return case


@pytest.mark.long
@pytest.mark.parametrize(("size", "end"), [(1e-6, 1.6), (1e-3, 24.0)])
def test_uniform_strain_is_held(size: float, end: float, tmp_path: Path) -> None:
    """What is left is of second order: corrections balance strains to first order."""
    run = run_case(strained(box(end), size), tmp_path)
    assert strain_error(run) < 10.0 * size**2
    assert abs(sum(energies(run)) - 1.0).max() < max(1e-7, 3e-11 / size)


@pytest.mark.long
def test_uniform_strain_is_held_around_two_regions(tmp_path: Path) -> None:
    regions = ((7.3, 18.4), (6.7, 16.9)), ((26.6, 37.2), (6.4, 17.2))
    case = two_regions("force", (44, 24), *regions)
    case["coupling"] = SITES
    gradient = [[1e-3, 5e-4], [0.0, -5e-4]]
    case["initial"] = {"stretch": {"gradient": gradient, "center": [22.0 * H, 12.0 * H]}}
    case["time"]["end"] = case["output"]["interval"] = 12.0
    run = run_case(case, tmp_path)
    assert strain_error(run) < 1e-6
    assert abs(sum(energies(run)) - 1.0).max() < 1e-6


@pytest.mark.long
def test_energy_has_no_trend(tmp_path: Path) -> None:
    """Waves cross all faces and corners for 1500 coupling steps."""
    total = sum(energies(run_case(box(120.0), tmp_path)))
    assert abs(total - 1.0).max() < 2e-3
    first, last = (total[part].mean() for part in (slice(150, 500), slice(-500, None)))
    assert abs(last - first) < 1e-4


@pytest.mark.long
@pytest.mark.parametrize(
    ("wavelength", "way", "R", "T"),
    [(8.0, "out", 0.004, 0.99), (12.0, "out", 0.002, 0.99), (8.0, "into", 0.027, 0.97)],
)
def test_waves_cross(wavelength: float, way: Any, R: float, T: float, tmp_path: Path) -> None:
    """Into the atoms R is that of the grid alone, .023, since the packet is no mode of the grid."""
    case = strip_case(wavelength, way, md_steps=16, md_timestep=0.005, coupling=SITES)
    reflected, transmitted = crossing(run_case(case, tmp_path))
    assert reflected < R
    assert T < transmitted < 1.01


@pytest.mark.long
@pytest.mark.parametrize(("way", "R", "T"), [("out", 0.006, 0.985), ("into", 0.014, 0.98)])
def test_waves_cross_levels(way: Any, R: float, T: float, tmp_path: Path) -> None:
    """A wave of 24 cells, 12 of the coarser level 16 cells away; the grid alone has R = .009."""
    case = strip_case(24.0, way, md_steps=16, md_timestep=0.005, coupling=SITES)
    reflected, transmitted = crossing(run_case(nested(case), tmp_path))
    assert reflected < R
    assert T < transmitted < 1.01


@pytest.mark.long
def test_uniform_strain_is_held_on_levels(tmp_path: Path) -> None:
    """All that is left is at the rim of the finer level, the same as with the force scheme."""
    case = strained(box(1.6), 1e-6)
    case["domain"]["box"] = [[0.0, 44 * H], [0.0, 40 * H]]
    case["md"]["region"] = [[15.3 * H, 26.8 * H], [14.2 * H, 23.9 * H]]
    case["grid"]["cell"] = 2.0 * H
    case["grid"]["levels"] = [{"boxes": [[[10 * H, 32 * H], [10 * H, 28 * H]]]}]
    run = run_case(case, tmp_path)
    assert strain_error(run) < 5e-9


@pytest.mark.long
@pytest.mark.parametrize("ranks", [1, 2])
def test_planes_that_end_at_a_face_stay_at_rest(ranks: int, tmp_path: Path) -> None:
    """On levels. The surface of the crystal relaxes, and strains the points next to it a little."""
    case = box(8.0)
    case["domain"]["box"] = [[0.0, 40 * H], [0.0, 40 * H]]
    case["md"] |= {"region": [[0.0, 12.2 * H], [14.2 * H, 25.1 * H]], "minimize": True}
    case["grid"]["cell"] = 2.0 * H
    case["grid"]["levels"] = [{"boxes": [[[0.0, 18 * H], [10 * H, 30 * H]]]}]
    case["initial"] = {}
    case["continuum"] |= {"ranks": ranks, "patches": [1, ranks]}
    run = run_plate(case, tmp_path)
    assert np.abs(run.points().fields["strain"]).max() < AT_REST


@pytest.mark.long
@pytest.mark.parametrize(("md", "gimp"), [([2, 1], [1, 1]), ([1, 2], [2, 1]), ([1, 1], [2, 2])])
def test_ranks_change_round_off_only(md: list[int], gimp: list[int], tmp_path: Path) -> None:
    case = box(4.0)
    whole = run_case(copy.deepcopy(case), tmp_path / "one")
    parts = run_case(on_patches(case, md, gimp), tmp_path / "parts")
    one, other = displacements(whole), displacements(parts)
    assert np.abs(one).max() > 1e-4
    assert np.abs(other - one).max() < 1e-9 * H
    for a, b in zip(energies(whole), energies(parts), strict=True):
        assert np.abs(a - b).max() < 1e-9


def absorbing(end: float, **settings: float) -> dict[str, Any]:
    """The box with an absorber, whose band fills it."""
    case = box(end)
    case["coupling"] = SITES | {"absorber": settings}
    return case


@pytest.mark.long
@pytest.mark.parametrize(("length", "kind"), [(2.0, "P"), (3.5, "P"), (3.5, "S")])
def test_the_absorber_takes_short_waves(length: float, kind: Any, tmp_path: Path) -> None:
    run = run_case(leaving("sites", Wave(length, kind), {}), tmp_path)
    assert crossing(run)[0] < 0.05
    assert run.energies.largest_imbalance() < 0.015


@pytest.mark.long
@pytest.mark.parametrize("kind", ["P", "S"])
def test_the_absorber_leaves_waves_of_eight_cells(kind: Any, tmp_path: Path) -> None:
    """Without it T is .9996 and .9986."""
    run = run_case(leaving("sites", Wave(8.0, kind), {}), tmp_path)
    reflected, transmitted = crossing(run)
    assert reflected < 0.003
    assert transmitted > {"P": 0.9996, "S": 0.9986}[kind] - 0.005


@pytest.mark.long
def test_the_absorber_leaves_uniform_strain_alone(tmp_path: Path) -> None:
    case = strained(absorbing(1.6), 1e-6)
    run = run_case(case, tmp_path)
    assert strain_error(run) < 1e-11
    assert np.abs(run.energies.dissipated).max() < 1e-9 * run.energies.energy[0]


@pytest.mark.long
@pytest.mark.parametrize(("md", "gimp"), [([2, 1], [1, 2]), ([2, 2], [1, 1])])
def test_ranks_change_the_absorber_by_round_off_only(
    md: list[int], gimp: list[int], tmp_path: Path
) -> None:
    case = absorbing(4.0, temperature=1e-6)
    whole = run_case(copy.deepcopy(case), tmp_path / "one")
    parts = run_case(on_patches(case, md, gimp), tmp_path / "parts")
    one, other = displacements(whole), displacements(parts)
    assert np.abs(one).max() > 1e-4
    assert np.abs(other - one).max() < 1e-9 * H
    taken = whole.energies.dissipated
    assert taken[-1] > 1e-3 * whole.energies.energy[0]
    assert np.abs(parts.energies.dissipated - taken).max() < 1e-9 * taken[-1]


@pytest.mark.long
@pytest.mark.parametrize("absorbed", [False, True])
def test_a_run_goes_on_from_a_checkpoint_with_the_same_bits(absorbed: bool, tmp_path: Path) -> None:
    case = absorbing(4.0, temperature=1e-6) if absorbed else box(4.0)
    case |= {"checkpoint": {"steps": 10, "keep": 100}}
    whole = run_case(case, tmp_path / "whole").folder
    rest = cut(whole, tmp_path / "rest", 20)
    done = resume(Command(tmp_path / "case"), rest)
    assert done.returncode == 0, done.stdout + done.stderr
    check_same_bits(whole, rest)


AT_REST = 2.5e-3
"""Largest strain of points where planes end at a face of the body."""


def run_plate(case: dict[str, Any], folder: Path) -> Run:
    """Run a case whose atoms, of `SCRIPT`, lie half a layer inside the lower faces."""
    case["md"] |= {
        "input": "plate.in",
        "variables": {"boundary_x": "s", "boundary_y": "s"},
        "files": [],
    }
    (folder / "plate.in").write_text(SCRIPT)
    return run_in(case, folder)


@pytest.mark.parametrize(
    ("size", "end"), [(1e-6, 1.6), pytest.param(1e-3, 12.0, marks=pytest.mark.long)]
)
def test_uniform_strain_is_held_by_embedded_atoms(size: float, end: float, tmp_path: Path) -> None:
    """A many-body potential, for which Cauchy's relation C12 = C66 does not hold."""
    embedded.write_potential(tmp_path)
    density = embedded.density_at_rest(tmp_path)
    case = strained(box(end), size)
    script, head, tail = SCRIPT, "variable density", "pair_style"
    script = script.replace(script[script.index(head) : script.index("lattice")], "")
    script = script.replace("${density}", f"{density:.17g}")
    (tmp_path / "plate.in").write_text(script[: script.index(tail)] + embedded.STYLE)
    (tmp_path / "cell.in").write_text(embedded.CELL.format(density=density) + embedded.STYLE)
    case["md"] |= {"input": "plate.in", "files": ["embedded.eam"]}
    case["md"]["variables"] = {"boundary_x": "s", "boundary_y": "s"}
    case["continuum"]["material"] = {"from": "md", "cell": "cell.in"}
    run = run_in(case, tmp_path)
    assert strain_error(run) < 10.0 * size**2
    assert abs(sum(energies(run)) - 1.0).max() < max(1e-7, 1e-10 / size)
