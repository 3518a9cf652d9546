"""Atoms from a dump written by hand, and the lattice that they form."""

import numpy as np
import pytest

from gimpmd_deploy.results.atoms import AtomsFile, lattice_of
from gimpmd_schemas.errors import InputError
from tests.deploy.results.files import FRAME


def crystal(a: float, rows: int = 20) -> np.ndarray:
    """Hexagonal lattice."""
    sites = [
        (a * (i + 0.5 * (j % 2)), a * 3**0.5 / 2 * j) for j in range(rows) for i in range(rows)
    ]
    return np.array(sites)


def test_lattice_of_a_hexagonal_crystal():
    a = 1.1132
    spacing, area = lattice_of(crystal(a))
    assert spacing == pytest.approx(a, rel=1e-12)
    assert area == pytest.approx(a**2 * 3**0.5 / 2, rel=1e-12)


def test_lattice_of_a_square_crystal_with_a_hole():
    x, y = np.meshgrid(np.arange(30) * 2.0, np.arange(30) * 2.0)
    sites = np.stack([x.ravel(), y.ravel()], axis=1)
    sites = sites[np.hypot(*(sites - 29.0).T) > 8.0]
    assert lattice_of(sites) == pytest.approx((2.0, 4.0))


BASES = {
    "sc": [(0, 0, 0)],
    "bcc": [(0, 0, 0), (0.5, 0.5, 0.5)],
    "fcc": [(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)],
}


@pytest.mark.parametrize(("name", "spacing"), [("sc", 1.0), ("bcc", 0.75**0.5), ("fcc", 0.5**0.5)])
def test_lattice_of_cubic_crystals(name, spacing):
    a, basis = 3.6, np.array(BASES[name])
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    sites = a * (cells + basis).reshape(-1, 3)
    assert lattice_of(sites) == pytest.approx((a * spacing, a**3 / len(basis)))


def test_dump(tmp_path):
    path = tmp_path / "atoms.dump"
    path.write_text(FRAME.format(step=0) + FRAME.format(step=50))
    atoms = AtomsFile(path, timestep=0.02)
    assert atoms.times == [0.0, 1.0]
    assert atoms.counts == [4, 4]
    frame = atoms.read(1)
    assert frame.time == 1.0
    np.testing.assert_array_equal(frame.reference, [[0, 0], [2, 0], [0, 2], [2, 2]])
    np.testing.assert_array_equal(frame.position[0], [0.1, 0])
    np.testing.assert_array_equal(frame.displacement[[0, 2]], [[0.1, 0], [0, 0.5]])
    np.testing.assert_array_equal(frame.velocity[0], [7, 8])
    np.testing.assert_array_equal(frame.stress[0], [1, 2, 0.25])  # over an area of 4
    np.testing.assert_array_equal(frame.size, np.full((4, 2), 2.0))
    np.testing.assert_array_equal(frame.fields["id"], [1, 2, 3, 4])
    np.testing.assert_array_equal(frame.fields["type"], [1, 2, 1, 1])


def test_dump_in_three_dimensions(tmp_path):
    names = "id type x y z vx vy vz ux uy uz X0 Y0 Z0"
    stress = " ".join(f"s{ij}_volume" for ij in ("xx", "yy", "zz", "yz", "xz", "xy"))
    sites = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)]
    rows = [
        f"{k + 1} 1 {x} {y} {z} 1 2 3 0 0 0 {x} {y} {z} 8 16 24 32 40 48"
        for k, (x, y, z) in enumerate(sites)
    ]
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n8\nITEM: BOX BOUNDS ss ss ss\n" + 3 * "0 2\n"
    path = tmp_path / "atoms.dump"
    path.write_text(f"{head}ITEM: ATOMS {names} {stress}\n" + "\n".join(rows) + "\n")
    frame = AtomsFile(path, timestep=1.0).read(0)
    assert frame.dim == 3
    np.testing.assert_array_equal(frame.reference, sites)
    np.testing.assert_array_equal(frame.velocity[0], [1, 2, 3])
    np.testing.assert_allclose(frame.stress[0], [1, 2, 3, 4, 5, 6])  # over a volume of 8


def test_half_written_frame_is_left_out(tmp_path):
    path = tmp_path / "atoms.dump"
    path.write_text(FRAME.format(step=0) + FRAME.format(step=50)[:-8])
    assert AtomsFile(path, 0.02).times == [0.0]


def test_a_missing_column_is_named(tmp_path):
    path = tmp_path / "atoms.dump"
    path.write_text(FRAME.format(step=0).replace(" ux", " other"))
    with pytest.raises(InputError, match="has no column ux"):
        AtomsFile(path, 0.02).read(0)
