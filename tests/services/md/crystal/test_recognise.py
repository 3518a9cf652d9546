"""The crystal that atoms form, made by LAMMPS in any orientation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.recognise import Crystal, recognise
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.errors import BackendError

ALONG = "orient x 1 0 0 orient y 0 1 0 orient z 0 0 1"
DENSE = "orient x 1 -1 0 orient y 1 1 1 orient z -1 -1 2"
EDGES = "orient x 1 1 0 orient y -1 1 0 orient z 0 0 1"
A = 3.6


def made(lattice: str, folder: Path, types: Sequence[int] = (1,)) -> tuple[np.ndarray, np.ndarray]:
    """Positions and types of the atoms of a LAMMPS lattice."""
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    basis = " ".join(f"basis {k} {kind}" for k, kind in enumerate(types, 1) if len(types) > 1)
    try:
        engine.commands(
            [
                "units metal",
                "boundary s s s",
                f"lattice {lattice}",
                "region box block 0.1 32.1 0.3 32.3 -0.2 31.8 units box",
                "create_box 2 box",
                f"create_atoms 1 region box {basis}",
                "mass * 1.0",
            ]
        )
        return engine.vectors("x").copy(), engine.atoms("type").copy()
    finally:
        engine.close()


@pytest.mark.parametrize(
    ("structure", "orientation", "atoms", "layers", "periods"),
    [
        ("fcc", ALONG, 1, (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),
        ("fcc", EDGES, 1, (8**-0.5, 8**-0.5, 0.5), (2**-0.5, 2**-0.5, 1.0)),
        ("fcc", DENSE, 1, (8**-0.5, 3**-0.5, 24**-0.5), (2**-0.5, 3**0.5, 1.5**0.5)),
        ("bcc", ALONG, 1, (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),
        ("bcc", EDGES, 1, (2**-0.5, 2**-0.5, 0.5), (2**0.5, 2**0.5, 1.0)),
        ("sc", ALONG, 1, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
        ("diamond", ALONG, 2, (0.25, 0.25, 0.25), (1.0, 1.0, 1.0)),
        ("hcp", ALONG, 2, (0.5, None, (2 / 3) ** 0.5), (1.0, 3**0.5, (8 / 3) ** 0.5)),
    ],
)
def test_cubic_crystals_and_hcp(
    structure: str,
    orientation: str,
    atoms: int,
    layers: Sequence[float | None],
    periods: Sequence[float],
    tmp_path: Path,
) -> None:
    x, kinds = made(f"{structure} {A} {orientation}", tmp_path)
    crystal = recognise(x, kinds)
    per_cell = {"fcc": 4, "bcc": 2, "sc": 1, "diamond": 8, "hcp": 2**0.5}[structure]
    assert len(crystal.basis) == atoms
    assert crystal.volume == pytest.approx(atoms * A**3 / per_cell)
    assert np.linalg.det(crystal.vectors) > 0.0
    assert crystal.misfit(x).max() < 1e-6
    for axis in range(3):
        assert crystal.period(axis) == pytest.approx(periods[axis] * A)
        found = crystal.layers(axis)
        assert found is not None
        spacing = layers[axis]
        assert found.spacing() == (None if spacing is None else pytest.approx(spacing * A))
        clear = np.abs(
            (x[:, axis, None] - found.midway() + 0.5 * found.period) % found.period
            - 0.5 * found.period
        )
        assert clear.min() > 0.1


def test_layers_of_diamond_111_are_uneven(tmp_path: Path) -> None:
    found = recognise(*made(f"diamond {A} {DENSE}", tmp_path)).layers(1)
    assert found is not None
    assert found.spacing() is None
    assert found.period == pytest.approx(A / 3**0.5)
    gaps = np.diff(found.places) / found.period
    assert min(gaps[0], 1.0 - gaps[0]) == pytest.approx(0.25)


def test_an_ordered_alloy_has_a_larger_cell(tmp_path: Path) -> None:
    """L1_2: one corner of the fcc cell is another element."""
    crystal = recognise(*made(f"fcc {A}", tmp_path, (2, 1, 1, 1)))
    assert crystal.volume == pytest.approx(A**3)
    assert sorted(crystal.kinds) == [1, 1, 1, 2]


def test_a_turned_crystal_has_no_layers(tmp_path: Path) -> None:
    x, kinds = made(f"fcc {A}", tmp_path)
    c, s = np.cos(0.3), np.sin(0.3)
    crystal = recognise(x @ [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]], kinds)
    assert crystal.layers(0) is None
    assert crystal.period(0) is None
    assert crystal.period(2) == pytest.approx(A)


def test_a_plane_crystal() -> None:
    i, j = np.meshgrid(np.arange(12), np.arange(12))
    x = np.column_stack([(i + 0.5 * (j % 2)).ravel(), 3**0.5 / 2 * j.ravel()])
    crystal = recognise(x, np.ones(len(x), int))
    assert crystal.volume == pytest.approx(3**0.5 / 2)
    assert [crystal.period(axis) for axis in range(2)] == pytest.approx([1.0, 3**0.5])


def test_sites_fill_a_box_that_is_open_above() -> None:
    vectors, origin = np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([0.25, 0.5])
    basis = np.array([[0.0, 0.0], [0.75, 0.5]])
    found = Crystal(vectors, origin, basis, np.array([1, 2])).sites(((0.25, 2.25), (0, 2)))
    expected = [
        [(0.25, 0.5), (0.75, 1.5), (1.25, 0.5), (1.75, 1.5)],
        [(0.5, 0.0), (1.0, 1.0), (1.5, 0.0), (2.0, 1.0)],
    ]
    for member, places in enumerate(expected):
        assert sorted(map(tuple, found.x[found.member == member].tolist())) == places


def test_a_gas_is_no_crystal() -> None:
    x = np.random.default_rng(1).uniform(0.0, 10.0, (500, 3))
    with pytest.raises(BackendError, match="form no crystal"):
        recognise(x, np.ones(500, int))


def test_types_without_order_are_no_crystal() -> None:
    x = np.stack(np.meshgrid(*3 * [np.arange(12.0)]), axis=-1).reshape(-1, 3)
    kinds = np.random.default_rng(1).integers(1, 3, len(x))
    with pytest.raises(BackendError, match="types must be in order near the planes"):
        recognise(x, kinds)
