"""Crystal and planes that LAMMPS finds for the force scheme, against the lattice it was given."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.find import find
from gimpmd_md.engines.lammps.script import Script, build
from gimpmd_schemas.case.form import FACES, Case, Crystal, Planes
from gimpmd_schemas.errors import BackendError
from tests.physics import embedded, lattice

Make = Callable[..., Case]
CUTOFF = 2.5
ROW = lattice.SPACING * 3**0.5 / 2
"""Distance of the close-packed rows."""


@pytest.fixture
def ask(folder: Path, make: Make) -> Callable[..., tuple[Crystal, Planes]]:
    """Build the atoms of the block with changes, and find crystal and planes."""

    def _ask(script: str = "", **changes: Any) -> tuple[Crystal, Planes]:
        if script:
            text = (folder / "block.in").read_text() + script
            (folder / "block.in").write_text(text)
        case = make(**{"coupling__scheme": "force"} | changes)
        engine = build(Script.of_case(case), MPI.COMM_SELF, folder / "log.lammps")
        try:
            return find(case, engine, engine.pair_cutoff())
        finally:
            engine.close()

    return _ask


def layers(crystal: Crystal, axis: int) -> float:
    """Distance of layers across an axis of the hexagonal crystal with rows along x."""
    return (lattice.SPACING / 2, ROW)[axis]


def test_the_lattice_of_the_script(ask) -> None:
    crystal, _ = ask()
    a = lattice.SPACING
    np.testing.assert_allclose(crystal.vectors, [[a, 0], [a / 2, ROW]], rtol=1e-14, atol=0)
    # origin 0.25 0.25 of a cell a x sqrt(3) a
    sites = (np.array(crystal.origin) - [0.25 * a, 0.5 * ROW]) @ np.linalg.inv(crystal.vectors)
    np.testing.assert_allclose(sites, np.round(sites), atol=1e-12)


def test_the_star_is_that_of_the_lattice(ask) -> None:
    """Three shells of six within 2.5, one of each two opposite bonds, shortest first."""
    bonds = np.array(ask()[0].bonds)
    length = np.hypot(*bonds.T)
    assert np.all(np.diff(length) > -1e-12)
    np.testing.assert_allclose(length, np.repeat([1.0, 3**0.5, 2.0], 3) * lattice.SPACING)
    both = np.concatenate([bonds, -bonds])
    exact = lattice.NEIGHBOURS[np.hypot(*lattice.NEIGHBOURS.T) < CUTOFF]
    order = np.lexsort(np.round(both, 9).T), np.lexsort(np.round(exact, 9).T)
    np.testing.assert_allclose(both[order[0]], exact[order[1]], atol=1e-13)


def test_bond_energies_are_the_potential(ask) -> None:
    """Of 4 (r^-12 - r^-6) up to the reach: force within 1e-9, at rest within 1e-12."""
    crystal, _ = ask()
    assert crystal.stretch_limit == 0.12
    s = np.linspace(1.0 - crystal.stretch_limit, 1.0 + crystal.stretch_limit, 1001)
    for bond, energy in zip(crystal.bonds, crystal.energy, strict=True):
        square = bond[0] ** 2 + bond[1] ** 2
        slope = 4.0 * (3.0 * (s * square) ** -4 - 6.0 * (s * square) ** -7) * square
        c = np.array(energy)
        found = np.polynomial.Polynomial(c * np.arange(1, len(c) + 1))(s - 1.0)
        assert np.abs(found - slope).max() < 1e-9 * np.abs(slope).max()
        assert found[500] == pytest.approx(slope[500], rel=1e-12)
        value = 4.0 * ((s * square) ** -6 - (s * square) ** -3)
        np.testing.assert_allclose(
            np.polynomial.Polynomial([value[500], *c])(s - 1.0), value, rtol=1e-9, atol=1e-11
        )


TABLE = (
    "run 0 post no\npair_write 1 1 1000 rsq 0.8 2.5 lj.table LJ\n"
    "pair_style table {}\npair_coeff 1 1 lj.table LJ\n"
)
STYLES = {
    "lepton": ("pair_style lepton 2.5\npair_coeff 1 1 '4*(r^-12-r^-6)'\n", 2e-12),
    "mie/cut": ("pair_style mie/cut 2.5\npair_coeff 1 1 1 1 12 6\n", 2e-12),
    "hybrid": (
        "pair_style hybrid/overlay lj/cut 2.5 gauss 2.5\n"
        "pair_coeff 1 1 lj/cut 1 1\npair_coeff 1 1 gauss 0 1\n",
        2e-12,
    ),
    "table of splines": (TABLE.format("spline 1000"), 1e-7),
    "table of lines": (TABLE.format("linear 20000"), 2e-6),
}
"""The same potential by other pair styles; error of a bond's force, over its largest force."""


@pytest.mark.parametrize("name", STYLES)
def test_other_styles_make_the_same_crystal(ask, name: str) -> None:
    script, error = STYLES[name]
    crystal, planes = ask()
    found, same_planes = ask(script)
    assert same_planes == planes
    np.testing.assert_array_equal(found.bonds, crystal.bonds)
    assert found.stretch_limit == crystal.stretch_limit
    s = np.linspace(1.0 - crystal.stretch_limit, 1.0 + crystal.stretch_limit, 1001)
    for energy, exact in zip(found.energy, crystal.energy, strict=True):
        a, b = (np.polynomial.Polynomial([0.0, *c]).deriv()(s - 1.0) for c in (energy, exact))
        assert np.abs(a - b).max() < error * np.abs(b).max()


MANY_BODIES = {
    "eam/alloy": embedded.STYLE,
    "sw": "pair_style sw\npair_coeff * * three.sw X\n",
    "hybrid/overlay": "pair_style hybrid/overlay lj/cut 2.5 sw\npair_coeff 1 1 lj/cut 1 1\n"
    "pair_coeff * * sw three.sw X\n",
}


@pytest.mark.parametrize("name", MANY_BODIES)
def test_other_potentials_are_refused(ask, folder: Path, name: str) -> None:
    """By name: of EAM, for one, ``pair_write`` would tell a part without a word."""
    embedded.write_potential(folder)
    (folder / "three.sw").write_text("X X X 1 1 1.8 21 1.2 -0.333333 7.05 0.602 4 0 0\n")
    with pytest.raises(BackendError) as told:
        ask(MANY_BODIES[name])
    styles = "lj/cut, sw" if "hybrid" in name else name
    assert f"gimpmd does not know pair_style {styles} as a sum over pairs" in str(told.value)
    assert "set coupling.scheme: velocity" in str(told.value)


@pytest.mark.parametrize("cell", [1.3, 2.6, 5.2])
@pytest.mark.parametrize("outer", [None, 3.1])
def test_planes_lie_midway_deep_enough_and_close_to_a_node_line(ask, cell, outer) -> None:
    region = [[13.0, 39.0], [13.0, 39.0]]
    crystal, planes = ask(grid__cell=cell, coupling__zones__outer=outer)
    for n, name in enumerate(FACES[:4]):
        (axis, side), plane = divmod(n, 2), getattr(planes, name)
        out, layer = (-1.0, 1.0)[side], layers(crystal, axis)
        middle = (plane - crystal.origin[axis]) / layer % 1.0
        assert middle == pytest.approx(0.5, abs=1e-9)
        depth = (region[axis][side] - plane) * out
        least = max(CUTOFF, outer or 0.0)
        shallowest = least + (depth - least) % layer
        assert least <= depth <= shallowest + cell + layer
        # the nearest to its node line, on the continuum's side, of all in that range
        others = plane - out * layer * (
            np.arange(int(cell / layer) + 2) - round((depth - shallowest) / layer)
        )
        assert (others * out / cell % 1.0).min() == pytest.approx(plane * out / cell % 1.0)


def test_faces_on_the_rim_are_no_interface(ask) -> None:
    _, planes = ask(md__region=[[0, 26], [26, 52]])
    assert (planes.left, planes.top) == (None, None)
    assert planes.right is not None
    assert planes.bottom is not None


@pytest.mark.parametrize("rows", [1, 14])
def test_a_strip_across_a_periodic_direction(ask, rows: int) -> None:
    """Even where the period is shorter than the cutoff."""
    height = 2.0 * ROW * rows
    crystal, planes = ask(
        domain__box=[[0, 52], [0, height]],
        domain__periodic=[False, True],
        grid__cell=height / (4 * rows - 3),
        md__region=[[13, 39], [0, height]],
        md__variables={"edge": "p"},
    )
    assert (planes.bottom, planes.top) == (None, None)
    assert len(crystal.bonds) == 9


def test_a_vacancy_is_told_by_its_place(ask) -> None:
    hole = "region hole sphere 15.3065 26.5117 0 0.2 units box\ndelete_atoms region hole\n"
    with pytest.raises(BackendError, match=r"no atom at \(15.3065, 26.5117\), .*: velocity"):
        ask(hole)


def test_a_vacancy_deep_inside_does_not_matter(ask) -> None:
    hole = "region hole sphere 26 26 0 0.6 units box\ndelete_atoms region hole\n"
    assert ask(hole)[1] == ask()[1]


def test_missing_ghosts_are_told(ask) -> None:
    """Atoms that end short of the region's left face."""
    cut = "region cut block EDGE 14.4 EDGE EDGE EDGE EDGE units box\ndelete_atoms region cut\n"
    with pytest.raises(BackendError, match=r"no atom at \(1[34]\.\d+, .* a site of the crystal"):
        ask(cut)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            "region r block 16 18 20 30 -1 1 units box\ngroup g region r\n"
            "displace_atoms g random 0.003 0.003 0 5\n",
            r"off the lattice .* set coupling.scheme: v",
        ),
        (
            "region r block 13 20 13 20 -1 1 units box\ngroup g region r\nset group g type 2\n",
            "types 1, 2 and masses 1, 2",
        ),
        ("pair_style lj/cut 2.2271\npair_coeff * * 1 1\n", "neighbours cross the cutoff 2.2271"),
    ],
    ids=["disorder", "two types", "cutoff"],
)
def test_what_does_not_suit_is_refused(ask, folder, script: str, words: str) -> None:
    if "type 2" in script:
        path = folder / "block.in"
        text = path.read_text().replace("create_box 1", "create_box 2")
        text = text.replace("pair_coeff 1 1", "mass 2 2\npair_coeff * *")
        path.write_text(text)
    with pytest.raises(BackendError, match=words):
        ask(script)


def test_a_crystal_askew_has_no_rows_along_the_faces(ask, folder) -> None:
    path = folder / "block.in"
    path.write_text(
        path.read_text().replace("origin 0.25 0.25 0", "orient x 3 1 0 orient y -1 3 0")
    )
    with pytest.raises(BackendError, match="no rows of atoms along the left face"):
        ask()


def test_a_narrow_region_has_no_room_for_planes(ask) -> None:
    with pytest.raises(BackendError, match="too narrow along x for the planes"):
        ask(md__region=[[20, 25], [13, 39]])
