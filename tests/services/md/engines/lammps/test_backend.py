"""LAMMPS as a backend: driving, work and energy, units, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_md.coupling.scheme import BOUNDARY
from gimpmd_md.engines.lammps.backend import LammpsBackend
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import EPSILON, MASS, SIGMA, TAU, argon

Start = Callable[[Case], LammpsBackend]
Make = Callable[..., Case]

ALONE: dict[str, Any] = {
    "only": "md",
    "domain__box": [[0, 26], [0, 26]],
    "md__region": [[0, 26], [0, 26]],
}
"""The block without a continuum, free all around."""


def advance_alone(backend: LammpsBackend, windows: int) -> None:
    for _ in range(windows):
        backend.advance(np.zeros((0, 2)))


def total(energies: dict[str, float]) -> float:
    return energies["kinetic"] + energies["potential"]


def part(backend: LammpsBackend, bits: int) -> np.ndarray:
    return (backend.engine.atoms("i_gimpmd_part") & bits) != 0


# --- the zones ---------------------------------------------------------------------------


def test_offers_inner_and_needs_outer_nodes(start: Start, make: Make) -> None:
    case = make()
    backend = start(case)
    grid, zones = case.background_grid(), case.zones()
    np.testing.assert_array_equal(backend.offers, zones.inner_nodes(grid))
    np.testing.assert_array_equal(backend.needs, zones.outer_nodes(grid))
    fields = backend.zone_fields()
    assert {name: field.shape[1:] for name, field in fields.items()} == {
        "mass": (),
        "velocity": (2,),
    }


def test_a_resting_body_stays_at_rest(start: Start, make: Make) -> None:
    backend = start(make())
    for _ in range(10):
        backend.advance(np.zeros((backend.needs.size, 2)))
    assert np.abs(backend.zone_fields()["velocity"]).max() < 1e-6
    assert total(backend.energies()) == pytest.approx(0.0, abs=1e-8)


def test_boundary_atoms_follow_a_uniform_velocity_exactly(start: Start, make: Make) -> None:
    case = make()
    backend = start(case)
    rest = backend.engine.pairs("x")[part(backend, BOUNDARY)]
    velocity = np.array([0.03, -0.02])
    for _ in range(10):
        backend.advance(np.tile(velocity, (backend.needs.size, 1)))
    x = backend.engine.pairs("x")[part(backend, BOUNDARY)]
    key = np.lexsort(rest.round(6).T)
    moved = x[np.lexsort((x - 10 * case.step() * velocity).round(6).T)] - rest[key]
    np.testing.assert_allclose(moved, np.tile(10 * case.step() * velocity, (len(x), 1)), atol=1e-12)


def test_a_body_that_moves_as_a_whole_shows_its_velocity_on_the_nodes(
    start: Start, make: Make
) -> None:
    backend = start(make())
    backend.engine.pairs("v")[:] = (0.03, -0.02)
    for _ in range(3):
        backend.advance(np.tile([0.03, -0.02], (backend.needs.size, 1)))
    fields = backend.zone_fields()
    heavy = fields["mass"] > 1e-6
    spread = np.abs(fields["velocity"][heavy] - [0.03, -0.02]).max()
    assert spread < 1e-6


def test_boundary_velocity_is_interpolated_from_the_nodes(
    start: Start, make: Make, positions: Any
) -> None:
    case = make()
    backend = start(case)
    gradient = np.array([[0.001, 0.002], [-0.003, 0.001]])
    before = backend.engine.pairs("x").copy()
    order = backend.engine.atoms("id").copy()
    backend.advance(positions(case, backend.needs) @ gradient.T)
    bound = part(backend, BOUNDARY)
    place = np.argsort(order)[np.searchsorted(np.sort(order), backend.engine.atoms("id"))]
    np.testing.assert_allclose(
        backend.engine.pairs("v")[bound], (before[place] @ gradient.T)[bound], atol=1e-13
    )


# --- energy and work ----------------------------------------------------------------------


def test_energy_of_md_alone_is_conserved(start: Start, make: Make) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    backend = start(make(**ALONE, initial={"packets": [packet]}))
    first = backend.energies()
    assert first["kinetic"] > 0.0
    assert first["potential"] > 0.0
    advance_alone(backend, 50)
    last = backend.energies()
    assert total(last) == pytest.approx(total(first), rel=2e-4)
    assert last["momentum_x"] == pytest.approx(first["momentum_x"], abs=1e-9)
    assert last["mass"] == backend.engine.lammps.get_natoms()


@pytest.mark.parametrize(
    ("fewer", "apart"),
    [
        ({"grid__levels": [{"boxes": [[[0, 26], [0, 26]]]}]}, 2),
        ({"output__energy_interval": 0.17}, 4),
    ],
)
def test_energies_are_those_of_the_times_wanted(
    start: Start, make: Make, fewer: dict[str, Any], apart: int
) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    changes = {**ALONE, "initial": {"packets": [packet]}}
    every, seldom = start(make(**changes)), start(make(**changes | fewer))
    for window in range(2 * apart):
        expected = {} if window % apart else every.energies()
        assert seldom.energies() == expected
        advance_alone(every, 1)
        advance_alone(seldom, 1)


def test_lammps_prints_and_so_tallies_at_common_times_alone(start: Start, make: Make) -> None:
    """At the last step of a window it would tally energy and stress of every atom."""
    nested = start(make(**ALONE, grid__levels=[{"boxes": [[[0, 26], [0, 26]]]}]))
    steps = nested.case.md_steps()
    for window in range(1, 5):
        advance_alone(nested, 1)
        last = window * steps if window % 2 == 0 else (window - 1) * steps  # else at its start
        assert nested.engine.lammps.last_thermo_step == last


def test_books_are_closed_once(start: Start, make: Make) -> None:
    """Whether or not ``finish`` is called, and however often energies are asked for."""
    loads = {"top": {"condition": "traction", "value": [0.05, 0.2], "ramp": 1.0}}
    plain, finished = (start(make(**ALONE, boundary=loads)) for _ in range(2))
    for _ in range(3):
        advance_alone(plain, 1)
        advance_alone(finished, 1)
        finished.finish()
        finished.finish()
    assert finished.energies() == plain.energies() == plain.energies()


def test_work_of_a_traction_is_the_energy_gained(start: Start, make: Make) -> None:
    loads = {
        "top": {"condition": "traction", "value": [0.05, 0.2], "ramp": 1.0},
        "bottom": {"condition": "traction", "value": [-0.05, -0.2], "ramp": 1.0},
    }
    backend = start(make(**ALONE, boundary=loads))
    advance_alone(backend, 60)
    energies = backend.energies()
    assert energies["external_work"] > 0.1
    assert total(energies) == pytest.approx(energies["external_work"], rel=1e-3)


def test_a_traction_gives_the_momentum_of_its_force(start: Start, make: Make) -> None:
    """One loaded face: the impulse is traction times length times the integral of the ramp."""
    top = {"condition": "traction", "value": [0.0, 0.2], "ramp": 1.0}
    backend = start(make(**ALONE, boundary={"top": top}))
    advance_alone(backend, 50)  # to t = 2
    impulse = 0.2 * 26.0 * (0.5 + 1.0)
    assert backend.energies()["momentum_y"] == pytest.approx(impulse, rel=2e-3)


def test_a_traction_on_a_coupled_region_loads_the_free_atoms_of_its_rim(
    start: Start, make: Make
) -> None:
    """Boundary atoms of the rim follow the grid, and the continuum bears their share."""
    top = {"condition": "traction", "value": [0.0, 0.2]}
    case = make(md__region=[[13, 39], [26, 52]], boundary={"top": top, "left": top})
    backend = start(case)
    engine = backend.engine
    lattice = engine.pairs("d2_gimpmd_lattice").copy()
    loaded = part(backend, 8 << 3)
    rim = lattice[:, 1] > lattice[:, 1].max() - 0.1
    free = case.zones().depth(lattice) >= case.zones().outer
    np.testing.assert_array_equal(loaded, rim & free)
    assert not part(backend, 8).any()  # the region does not reach the left face
    backend.advance(np.zeros((backend.needs.size, 2)))
    f = engine.pairs("f").copy()
    engine.commands(["unfix gimpmd_traction", "run 0 post no"])
    loaded = part(backend, 8 << 3)
    load = f - engine.pairs("f")
    np.testing.assert_allclose(load[loaded, 1], 0.2 * 26.0 / rim.sum(), rtol=1e-9)
    np.testing.assert_allclose(load[~loaded], 0.0, atol=1e-9)


def test_work_of_a_driven_face_is_the_energy_gained(start: Start, make: Make) -> None:
    case = make(
        **ALONE,
        boundary={
            "top": {"condition": "velocity", "value": [None, 0.05], "ramp": 1.0},
            "bottom": {"condition": "symmetry"},
        },
    )
    backend = start(case)
    y = {}
    order = np.argsort(backend.engine.atoms("id"))
    y["start"] = backend.engine.pairs("x")[order, 1].copy()
    advance_alone(backend, 50)
    energies = backend.energies()
    assert energies["external_work"] > 0.01
    assert total(energies) == pytest.approx(energies["external_work"], rel=5e-3)
    order = np.argsort(backend.engine.atoms("id"))
    moved = backend.engine.pairs("x")[order, 1] - y["start"]
    top, bottom = y["start"] > y["start"].max() - 2.4, y["start"] < y["start"].min() + 2.4
    np.testing.assert_allclose(moved[top], 0.05 * (2.0 - 0.5), atol=1e-12)
    np.testing.assert_allclose(moved[bottom], 0.0, atol=1e-12)
    assert np.ptp(backend.engine.pairs("x")[order, 0]) < 25.9  # sideways it is free to shrink


def test_interface_work_is_the_energy_gained(start: Start, make: Make, positions: Any) -> None:
    case = make()
    backend = start(case)
    engine = backend.engine
    pe0 = engine.stored("gimpmd_energy").sum()
    shape = np.sin(2.0 * np.pi * (positions(case, backend.needs) - 13.0) / 52.0)[:, ::-1]
    for k in range(60):
        backend.advance(0.05 * np.sin(0.1 * (k + 0.5)) * shape)
    free = ~part(backend, BOUNDARY)
    v = engine.pairs("v")[free]
    gained = engine.stored("gimpmd_energy").sum() - pe0 + 0.5 * float((v * v).sum())
    work = backend.energies()["interface_work"]
    assert gained > 0.1
    assert work == pytest.approx(gained, rel=0.01)


# --- set-up -------------------------------------------------------------------------------


def test_the_script_gets_the_domain_in_a_run_of_md_alone(start: Start, make: Make) -> None:
    whole = start(make(only="md"))
    x = whole.engine.pairs("x")
    assert np.ptp(x, axis=0).min() > 50.0
    assert whole.offers.size == 0
    assert whole.needs.size == 0


def test_relaxation_moves_surfaces_and_displacement_starts_at_zero(
    start: Start, make: Make
) -> None:
    backend = start(make(**ALONE))
    rest, lattice = (backend.engine.pairs(f"d2_gimpmd_{n}") for n in ("rest", "lattice"))
    assert 1e-3 < np.abs(rest - lattice).max() < 0.1
    assert np.abs(backend.engine.pairs("f")).max() < 1e-4
    raw = start(make(**ALONE, md__minimize=False))
    np.testing.assert_array_equal(
        raw.engine.pairs("d2_gimpmd_rest"), raw.engine.pairs("d2_gimpmd_lattice")
    )
    assert np.abs(raw.engine.pairs("f")).max() > 0.01


def test_dump_holds_displacements_and_both_references(
    start: Start, make: Make, folder: Path
) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    case = make(**ALONE, initial={"packets": [packet]}, output={"interval": 0.4})
    backend = start(case)
    advance_alone(backend, 10)
    backend.close()
    text = (folder / "atoms.dump").read_text()
    frames = text.split("ITEM: TIMESTEP\n")[1:]
    assert [int(frame.split("\n", maxsplit=1)[0]) for frame in frames] == [0, 200]
    head = frames[-1].split("ITEM: ATOMS ")[1].split("\n", maxsplit=1)[0].split()
    assert head == [
        "id",
        "type",
        "x",
        "y",
        "z",
        "vx",
        "vy",
        "ux",
        "uy",
        "X0",
        "Y0",
        "sxx_area",
        "syy_area",
        "sxy_area",
    ]
    rows = np.array([row.split() for row in frames[-1].split("\n")[8:] if row], dtype=float)
    np.testing.assert_array_equal(rows[:, 0], np.arange(1, len(rows) + 1))
    assert np.abs(rows[:, 7:9]).max() > 1e-4
    relaxed = rows[:, 2:4] - rows[:, 7:9] - rows[:, 9:11]
    assert np.abs(relaxed).max() < 0.1


def test_initial_packet_sets_both_displacement_and_velocity(start: Start, make: Make) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    energies = start(make(**ALONE, initial={"packets": [packet]})).energies()
    assert energies["potential"] == pytest.approx(energies["kinetic"], rel=0.05)


def test_metal_units_agree_with_reduced_units(
    start: Start, make: Make, positions: Any, folder: Path
) -> None:
    """The same crystal in argon's units: lengths, energies and fields scale."""
    reduced, scaled = make(), make(**argon())
    results = []
    for case, length, time in ((reduced, 1.0, 1.0), (scaled, SIGMA, TAU)):
        backend = start(case)
        x = positions(case, backend.needs) / length
        for k in range(10):
            wave = 0.05 * np.sin(0.3 * k) * np.sin(2.0 * np.pi * x / 26.0)
            backend.advance(wave[:, ::-1] * length / time)
        results.append((backend.zone_fields()["velocity"] * time / length, backend.energies()))
    (one, energies), (other, in_ev) = results
    np.testing.assert_allclose(other, one, atol=1e-7 * np.abs(one).max())
    for name in ("kinetic", "potential", "interface_work"):
        assert in_ev[name] / EPSILON == pytest.approx(energies[name], rel=1e-6), name
    assert in_ev["mass"] / MASS == pytest.approx(energies["mass"])


def test_periodic_strip_folds_and_unwraps(start: Start, make: Make) -> None:
    """A strip, periodic along y, that moves across its periodic face."""
    width = 12 * 1.1132013035564605 * 3**0.5  # 24 rows of atoms
    case = make(
        domain={"box": [[0, width * 3], [0, width]], "periodic": [False, True]},
        grid__cell=width / 8,
        md__region=[[width, 3 * width], [0, width]],
        md__variables={"edge": "p"},
        boundary={"right": {"condition": "velocity", "value": [0.0, 0.5]}},
    )
    backend = start(case)
    backend.engine.pairs("v")[:] = (0.0, 0.5)
    for _ in range(40):
        backend.advance(np.tile([0.0, 0.5], (backend.needs.size, 1)))
    fields = backend.zone_fields()
    assert np.abs(fields["velocity"][fields["mass"] > 1e-9] - [0.0, 0.5]).max() < 1e-6
    energies = backend.energies()
    assert energies["potential"] == pytest.approx(0.0, abs=1e-6)


# --- what it refuses ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pair_style lj/cut", "pair_style lj/cat", r"block.in: .*lj/cat"),
        ("mass 1 ${mass}", "include none.in", r"none.in"),
        ("mass 1 ${mass}", "", r"[mM]ass"),
        ("mass 1 ${mass}", "mass 1 1\nfix 1 all nve", r"fix 1 \(nve\) integrates"),
        ("mass 1 ${mass}", "mass 1 1\nfix t all nvt temp 1 1 1", r"fix t \(nvt\) integrates"),
        ("units ${style}", "units metal", r"units metal, but the case says units: lj"),
        ("dimension 2", "dimension 3", r"block.in: .*dimension"),
        ("create_atoms 1 region box", "", r"no atoms"),
        ("boundary s ${edge} p", "boundary p s p", r"periodic along x"),
        ("2.5*${scale}", "3.5*${scale}", r"cutoff 3.5 is wider than the outer zone 2.6"),
        ("region box block ${xlo}", "region box block 10", r"outside the MD region"),
    ],
)
def test_bad_scripts_are_refused_in_lammps_words(
    start: Start, make: Make, folder: Path, old: str, new: str, words: str
) -> None:
    text = (folder / "block.in").read_text()
    assert old in text
    (folder / "block.in").write_text(text.replace(old, new))
    with pytest.raises(BackendError, match=words):
        start(make())


def test_three_dimensions_are_refused(start: Start, make: Make, folder: Path) -> None:
    (folder / "block.in").write_text(
        "units lj\nboundary s s p\nregion box block ${xlo} ${xhi} ${ylo} ${yhi} -3 3\n"
        "create_box 1 box\ncreate_atoms 1 single 20 20 0\n"
    )
    with pytest.raises(BackendError, match=r"block.in: dimension 3; .* two-dimensional"):
        start(make())


def test_no_pair_style_is_refused(start: Start, make: Make, folder: Path) -> None:
    text = (folder / "block.in").read_text().split("pair_style")[0]
    (folder / "block.in").write_text(text)
    with pytest.raises(BackendError, match="sets no pair_style"):
        start(make())


def test_after_script_sees_the_groups(start: Start, make: Make, folder: Path) -> None:
    (folder / "after.in").write_text("fix drag gimpmd_free viscous 0.1\n")
    backend = start(make(md__after="after.in"))
    assert "drag" in backend.engine.fixes()
    (folder / "after.in").write_text("fix move gimpmd_free nve\n")
    with pytest.raises(BackendError, match=r"after.in: fix move \(nve\) integrates"):
        start(make(md__after="after.in"))


def test_after_script_leaves_the_steps_alone(start: Start, make: Make, folder: Path) -> None:
    (folder / "after.in").write_text("reset_timestep 100\n")
    with pytest.raises(BackendError, match=r"after.in: LAMMPS stands at step 100, not 0"):
        start(make(md__after="after.in"))


def test_ranks_must_match_the_patches(start: Start, make: Make) -> None:
    with pytest.raises(BackendError, match="started on 1 MPI ranks"):
        start(make(md__ranks=2))


@pytest.mark.parametrize("after", [None, "after.in"])
def test_atoms_stay_in_the_plane(start: Start, make: Make, folder: Path, after: str | None) -> None:
    """By themselves, or by a fix where something of the user's might push them out."""
    (folder / "after.in").write_text("fix bath gimpmd_free langevin 0.1 0.1 0.5 42\n")
    backend = start(make(md__after=after))
    assert ("gimpmd_plane" in backend.engine.fixes()) == (after is not None)
    rng = np.random.default_rng(0)
    for _ in range(5):
        backend.advance(rng.normal(scale=0.05, size=(backend.needs.size, 2)))
    for name in "xv":
        in_plane, out_of_it = np.split(backend.engine.atoms(name), [2], axis=1)
        assert np.ptp(in_plane) > 0.05
        assert not out_of_it.any()
