"""The sites scheme in three dimensions, in whole runs with copper by embedded atoms."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_deploy.results.run import Run
from gimpmd_deploy.verify.crossing import crossing
from tests.cases import on_patches
from tests.copper_sites import (
    ALUMINIUM,
    ALUMINIUM_JEA,
    COPPER,
    COPPER_110,
    COPPER_111,
    COPPER_FUNCFL,
    COPPER_SNAP,
    IRON,
    REFLECTED,
    SILICON,
    SILICON_110,
    SILICON_TERSOFF,
    TRANSMITTED,
    TUNGSTEN,
    TUNGSTEN_FINE,
    Ends,
    H,
    Metal,
    copper_case,
    on_levels,
    slab_on_levels,
    strained,
    two_columns,
    wave_case,
    wave_on_levels,
    write_scripts,
    write_scripts_of_two,
)
from tests.physics.strips import energies, run_in
from tests.physics.test_regions import displacements
from tests.system.conftest import Command
from tests.system.test_resume import check_same_bits, cut, resume

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

BODIES: dict[str, tuple[tuple[int, int, int], tuple[Ends, Ends, Ends]]] = {
    "slab": ((16, 2, 2), ((3.3, 12.7), None, None)),
    "column": ((12, 2, 12), ((2.3, 9.5), None, (2.4, 9.6))),
    "box": ((12, 12, 12), ((2.3, 9.5), (2.4, 9.6), (2.2, 9.3))),
    "deep box": ((14, 14, 14), ((3.3, 10.5), (3.4, 10.6), (3.2, 10.3))),
}
"""Cells of the body, and of the box of atoms: between two planes; with edges; with corners, and
farther from the faces of the body."""

RIM = 1e-2
"""Share of a uniform strain that may be missing at the rim of a finer level: its steps are half as
long as those of the larger cells, so forces there balance at every second step only. Measured: .004
at a plane rim, .005 at the edges of a box."""


def run_case(case: dict[str, Any], folder: Path, metal: Metal = COPPER) -> Run:
    """Run a case by the command."""
    write_scripts(folder, metal)
    return run_in(case, folder)


def run_two(case: dict[str, Any], folder: Path) -> Run:
    """Run a case of two regions of copper by the command."""
    write_scripts_of_two(folder)
    return run_in(case, folder)


def share(run: Run) -> float:
    """Part of the cell cut by the lower plane along x that lies in the continuum."""
    [interface] = run.plan.coupled.interfaces
    return float(interface.planes[0][0] / run.plan.finest_cell % 1.0)


def crossed(run: Run) -> tuple[float, float]:
    """What a packet leaves in the atoms, and in the continuum, of the energy at the start.

    Twice the kinetic energies count, as means over the last twentieth. The other energies of both
    sides have parts of first order in the displacements of the planes, which cancel in the sum.
    """
    found = run.energies
    late = found.time >= 0.95 * found.time[-1]
    kinetic = (side.kinetic[late].mean() for side in (found.md, found.continuum))
    left, passed = (float(2.0 * one / found.energy[0]) for one in kinetic)
    return left, passed


def most_reflected(run: Run) -> float:
    """Required of a packet of 8 cells: less where the plane cuts its cell well."""
    return 0.003 if 0.15 <= share(run) <= 0.6 else 0.008


def strain_errors(run: Run) -> np.ndarray:
    """Departure of the strain of each point at the end from the uniform one of the start."""
    gradient = np.array(run.case.initial.stretch.gradient)
    exact = gradient + gradient.T
    exact[np.diag_indices(3)] *= 0.5
    components = exact[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    return np.asarray(np.abs(run.points().fields["strain"] - components).max(axis=1))


def stirred(name: str, end: float, metal: Metal = COPPER) -> dict[str, Any]:
    """A body full of waves of 4 to 8 cells along its axes."""
    return stir(copper_case(*BODIES[name], end, metal), metal)


def stir(case: dict[str, Any], metal: Metal = COPPER) -> dict[str, Any]:
    """Fill a body with waves of 4 to 8 cells along its axes."""
    case["initial"] = {
        "packets": [
            {
                "center": place * case["domain"]["box"][axis][1],
                "wavelength": wavelength * metal.cell,
                "cycles": 1.0,
                "strain": 2e-4,
                "axis": axis,
                "direction": direction,
                "polarization": polarization,
            }
            for axis in range(3)
            if not case["domain"]["periodic"][axis]
            for place, wavelength, direction, polarization in (
                (0.2, 6.0, 1, "P"),
                (0.5, 8.0, -1, "S"),
                (0.7, 4.0, -1, "P"),
            )
        ]
    }
    return case


@pytest.mark.parametrize(
    ("name", "metal"),
    [
        *((name, COPPER) for name in ("slab", "column", "box")),
        *(("column", metal) for metal in (COPPER_110, ALUMINIUM, IRON, TUNGSTEN, SILICON)),
        *(("column", metal) for metal in (ALUMINIUM_JEA, COPPER_FUNCFL, SILICON_TERSOFF)),
        ("slab", COPPER_SNAP),
        ("deep box", SILICON),
        ("box", COPPER_111),
    ],
)
def test_uniform_strain_is_held(name: str, metal: Metal, tmp_path: Path) -> None:
    """What is left is of second order: corrections balance strains to first order.

    They cannot do so for a potential whose stiffness at rest is not that at small strains.
    """
    size = 1e-5
    run = run_case(strained(copper_case(*BODIES[name], 0.64, metal), size), tmp_path, metal)
    assert strain_errors(run).max() < 30.0 * size**2 + metal.roughness * size
    assert abs(sum(energies(run)) - 1.0).max() < metal.noise


@pytest.mark.parametrize(
    ("name", "metal", "model"),
    [
        ("slab", COPPER, "cauchy-born"),
        ("column", COPPER, "cauchy-born"),
        ("column", SILICON, "cauchy-born"),
        ("slab", COPPER, "lattice-sum"),
        ("column", COPPER, "lattice-sum"),
    ],
)
def test_uniform_strain_is_held_by_finite_elasticity(
    name: str, metal: Metal, model: str, tmp_path: Path
) -> None:
    """As by the linear law, whose stiffness these laws have at rest."""
    size = 1e-5
    case = strained(copper_case(*BODIES[name], 0.64, metal), size)
    case["continuum"]["material"]["model"] = model
    run = run_case(case, tmp_path, metal)
    assert strain_errors(run).max() < 30.0 * size**2
    assert abs(sum(energies(run)) - 1.0).max() < metal.noise


@pytest.mark.parametrize(
    ("model", "least", "most"),
    [("linear", 0.015, 1.0), ("cauchy-born", 0.0, 0.01), ("lattice-sum", 0.0, 2e-3)],
)
def test_finite_strain_is_held_by_finite_elasticity(
    model: str, least: float, most: float, tmp_path: Path
) -> None:
    """1 % in a column of copper; the errors are shares of it."""
    size = 1e-2
    case = strained(copper_case(*BODIES["column"], 0.64), size)
    case["continuum"]["material"]["model"] = model
    assert least < strain_errors(run_case(case, tmp_path)).max() / size < most


def silicon_110(end: float) -> dict[str, Any]:
    """A column two cells long, which needs a gradient term that goes round."""
    return copper_case((12, 2, 12), ((2.3, 9.7), None, (2.2, 10.0)), end, SILICON_110)


def test_uniform_strain_is_held_by_a_gradient_term_that_goes_round(tmp_path: Path) -> None:
    size = 1e-5
    run = run_case(strained(silicon_110(0.16), size), tmp_path, SILICON_110)
    assert strain_errors(run).max() < 30.0 * size**2
    assert abs(sum(energies(run)) - 1.0).max() < SILICON_110.noise


@pytest.mark.parametrize(
    ("name", "metal"), [("box", COPPER), ("column", COPPER_110), ("column", IRON)]
)
def test_energy_has_no_trend(name: str, metal: Metal, tmp_path: Path) -> None:
    """Waves cross all faces, edges and corners for 100 coupling steps."""
    check_no_trend(sum(energies(run_case(stirred(name, 3.2, metal), tmp_path, metal))))


@pytest.mark.parametrize("model", ["cauchy-born", "lattice-sum"])
def test_energy_has_no_trend_with_finite_elasticity(model: str, tmp_path: Path) -> None:
    case = stirred("column", 3.2)
    case["continuum"]["material"]["model"] = model
    check_no_trend(sum(energies(run_case(case, tmp_path))))


def test_uniform_strain_is_held_by_two_regions(tmp_path: Path) -> None:
    size = 1e-5
    run = run_two(strained(two_columns(0.64), size), tmp_path)
    assert strain_errors(run).max() < 30.0 * size**2
    assert abs(sum(energies(run)) - 1.0).max() < 1e-5


def test_energy_of_two_regions_has_no_trend(tmp_path: Path) -> None:
    """Means over ten steps vary by 2e-4 here, and the change of the mean was 1.8e-4."""
    check_no_trend(sum(energies(run_two(stir(two_columns(3.2)), tmp_path))), 4e-4)


def test_energy_has_no_trend_with_the_gradient_term(tmp_path: Path) -> None:
    """Faces {110}, {111} and {112}; the body begins with a rate of strain, and its faces are held.

    Waves of all lengths come from the faces.
    """
    case = copper_case(*BODIES["box"], 3.2, COPPER_111)
    middle = [0.5 * high for _, high in case["domain"]["box"]]
    rate = [[2e-3, 1e-3, 6e-4], [0.0, -1e-3, 4e-4], [-2e-4, 0.0, 1.4e-3]]
    velocities = {"velocity": [0.0] * 3, "gradient": rate, "center": middle}
    case["initial"] = {"velocities": [velocities]}
    check_no_trend(sum(energies(run_case(case, tmp_path, COPPER_111))))


def check_no_trend(total: np.ndarray, most: float = 2e-4) -> None:
    """Whether an energy of 100 coupling steps, over that of the start, stays where it is."""
    assert abs(total - 1.0).max() < 5e-3
    first, last = (total[part].mean() for part in (slice(20, 60), slice(-40, None)))
    assert abs(last - first) < most


@pytest.mark.parametrize(
    ("md", "gimp"), [([2, 1, 1], [1, 1, 2]), ([2, 2, 1], [1, 1, 1]), ([1, 1, 2], [2, 1, 2])]
)
def test_ranks_change_round_off_only(md: list[int], gimp: list[int], tmp_path: Path) -> None:
    check_ranks(md, gimp, COPPER, tmp_path)


def test_ranks_change_iron_by_round_off_only(tmp_path: Path) -> None:
    check_ranks([2, 1, 1], [1, 1, 2], IRON, tmp_path)


def test_ranks_change_inner_shifts_by_round_off_only(tmp_path: Path) -> None:
    check_ranks([2, 1, 2], [1, 1, 2], SILICON, tmp_path)


def test_ranks_change_a_gradient_term_that_goes_round_by_round_off_only(tmp_path: Path) -> None:
    case = stir(silicon_110(0.08), SILICON_110)
    whole = run_case(copy.deepcopy(case), tmp_path / "one", SILICON_110)
    parts = run_case(on_patches(case, [1, 1, 1], [2, 1, 1]), tmp_path / "parts", SILICON_110)
    check_same(whole, parts, SILICON_110)


def check_ranks(md: list[int], gimp: list[int], metal: Metal, tmp_path: Path) -> None:
    """Compare patches with one each."""
    case = stirred("column", 0.32, metal)
    whole = run_case(copy.deepcopy(case), tmp_path / "one", metal)
    parts = run_case(on_patches(case, md, gimp), tmp_path / "parts", metal)
    check_same(whole, parts, metal)


def check_same(whole: Run, parts: Run, metal: Metal = COPPER) -> None:
    """Whether two runs of moving atoms differ by round-off only."""
    one, other = displacements(whole), displacements(parts)
    assert np.abs(one).max() > 1e-3
    assert np.abs(other - one).max() < 1e-9 * metal.cell
    for a, b in zip(energies(whole), energies(parts), strict=True):
        assert np.abs(a - b).max() < 1e-9


def test_ranks_change_the_absorber_by_round_off_only(tmp_path: Path) -> None:
    """With edges of planes in the band, at a temperature."""
    case = stirred("column", 0.32)
    case["coupling"]["absorber"] = {"temperature": 0.1}
    whole = run_case(copy.deepcopy(case), tmp_path / "one")
    parts = run_case(on_patches(case, [2, 1, 1]), tmp_path / "parts")
    one, other = displacements(whole), displacements(parts)
    assert np.abs(one).max() > 1e-3
    assert np.abs(other - one).max() < 1e-9 * H
    taken = whole.energies.dissipated
    assert np.abs(parts.energies.dissipated - taken).max() < 1e-9 * np.abs(taken).max()


def test_uniform_strain_is_held_on_levels(tmp_path: Path) -> None:
    """A box with corners. At the rims of the finer level an error of first order is left."""
    size, middle = 1e-5, 18.0
    case = copper_case((36, 36, 36), ((14.3, 21.5), (14.4, 21.6), (14.2, 21.3)), 0.32)
    run = run_case(strained(on_levels(case, (8, 28), (8, 28), (8, 28)), size), tmp_path)
    off, points = strain_errors(run), run.points()
    beside = np.abs(points.reference / H - middle).max(axis=1) < 6.0
    assert off[beside].max() < 30.0 * size**2
    assert off.max() < RIM * size
    assert abs(sum(energies(run)) - 1.0).max() < 1e-5


def test_energy_has_no_trend_on_levels(tmp_path: Path) -> None:
    check_no_trend(sum(energies(run_case(stir(slab_on_levels(3.2)), tmp_path))))


def test_ranks_change_levels_by_round_off_only(tmp_path: Path) -> None:
    case = stir(slab_on_levels(0.32))
    whole = run_case(copy.deepcopy(case), tmp_path / "one")
    parts = run_case(on_patches(case, [2, 1, 1], [2, 1, 1]), tmp_path / "parts")
    check_same(whole, parts)


def test_a_wave_leaves_the_atoms_on_levels(tmp_path: Path) -> None:
    """The larger cells are as close as `gimpmd validate` lets pass without a word."""
    reflected, transmitted = crossing(run_case(wave_on_levels(), tmp_path))
    assert reflected < REFLECTED
    assert TRANSMITTED[0] < transmitted < TRANSMITTED[1]


@pytest.mark.parametrize("metal", [COPPER, SILICON])
@pytest.mark.parametrize("polarization", ["P", "S"])
def test_waves_of_eight_cells_leave_the_atoms(
    polarization: str, metal: Metal, tmp_path: Path
) -> None:
    """A packet of two cycles."""
    reflected, transmitted = crossing(
        run_case(wave_case(polarization, metal=metal), tmp_path, metal)
    )
    assert reflected < REFLECTED
    assert TRANSMITTED[0] < transmitted < TRANSMITTED[1]


@pytest.mark.parametrize(
    "metal", [COPPER_FUNCFL, ALUMINIUM_JEA, IRON, TUNGSTEN_FINE, SILICON_TERSOFF]
)
@pytest.mark.parametrize("polarization", ["P", "S"])
def test_waves_of_eight_cells_leave_other_crystals(
    polarization: str, metal: Metal, tmp_path: Path
) -> None:
    """As above; here the kinetic energies count."""
    run = run_case(wave_case(polarization, metal=metal), tmp_path, metal)
    reflected, transmitted = crossed(run)
    assert reflected < most_reflected(run)
    assert TRANSMITTED[0] < transmitted < TRANSMITTED[1]


@pytest.mark.parametrize(("wavelength", "polarization"), [(3.0, "P"), (4.0, "P"), (3.0, "S")])
def test_the_absorber_takes_short_waves(
    wavelength: float, polarization: str, tmp_path: Path
) -> None:
    """They start outside the band."""
    case = wave_case(polarization, wavelength, deeper=8.0)
    case["coupling"]["absorber"] = {}
    run = run_case(case, tmp_path)
    assert crossing(run)[0] < 0.05
    assert run.energies.largest_imbalance() < 0.015


def test_a_run_goes_on_from_a_checkpoint_with_the_same_bits(tmp_path: Path) -> None:
    case = stirred("column", 0.32) | {"checkpoint": {"steps": 5, "keep": 100}}
    whole = run_case(case, tmp_path / "whole").folder
    rest = cut(whole, tmp_path / "rest", 5)
    done = resume(Command(tmp_path / "case"), rest)
    assert done.returncode == 0, done.stdout + done.stderr
    check_same_bits(whole, rest)
