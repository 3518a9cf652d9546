"""Crystals at zero pressure, against published values and lattice sums."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.lattice import answer
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.lattice import Crystal, Potential, Question

GPA, MJ = 1e-4, 1e-2
"""GPa in a bar, and mJ/m^2 in a bar Angstrom."""

COPPER = Potential(
    structure="fcc",
    units="metal",
    pair_style="eam/alloy",
    pair_coeff=("* * Cu_mishin1.eam.alloy Cu",),
)
LJ = Potential(structure="hex", units="lj", pair_style="lj/cut 2.5", pair_coeff=("* * 1 1",))


def ask(potential: Potential) -> Crystal:
    return answer(Question(potential=potential), MPI.COMM_SELF)


def cubic(found: Crystal) -> tuple[float, float, float]:
    """C11, C12 and C44 in GPa."""
    C = GPA * np.array(found.stiffness)
    np.testing.assert_allclose(C[:3, :3], C[0, 1] + (C[0, 0] - C[0, 1]) * np.eye(3), rtol=1e-6)
    np.testing.assert_allclose(C[3:], np.hstack([np.zeros((3, 3)), C[3, 3] * np.eye(3)]), atol=1e-6)
    return C[0, 0], C[0, 1], C[3, 3]


def test_copper_of_mishin() -> None:
    """Mishin et al., Phys. Rev. B 63, 224106 (2001), tables II and III."""
    found = ask(COPPER)
    assert found.constant == pytest.approx(3.615, abs=5e-4)
    assert found.energy == pytest.approx(-3.54, abs=5e-4)
    assert cubic(found) == pytest.approx((169.9, 122.6, 76.2), abs=0.1)
    relaxed = {surface.plane: MJ * surface.relaxed for surface in found.surfaces}
    assert relaxed == pytest.approx({"(111)": 1239, "(100)": 1345, "(110)": 1475}, abs=1.0)
    assert found.density == pytest.approx(4 * 63.546 / found.constant**3, rel=1e-4)
    # waves in a cubic crystal: (C11, C44, C44), (C11 + C12 + 2 C44, 2 C44, C11 - C12) / 2
    c11, c12, c44 = cubic(found)
    kg_per_m3 = found.density * 1660.53907
    speeds = {waves.direction: np.array(waves.speeds) for waves in found.waves}  # A/ps = 100 m/s
    for direction, moduli in {
        "[100]": [c11, c44, c44],
        "[110]": [(c11 + c12 + 2 * c44) / 2, c44, (c11 - c12) / 2],
    }.items():
        expected = np.sqrt(1e9 * np.array(moduli) / kg_per_m3) / 100.0
        np.testing.assert_allclose(speeds[direction], expected, rtol=1e-5)


def test_a_hexagonal_lennard_jones_crystal() -> None:
    """Lattice sums, and the energy of the bonds that a close-packed row cuts."""
    found = ask(LJ)
    assert found.constant == found.neighbours == pytest.approx(1.1132013035564605, rel=1e-9)
    assert found.energy == pytest.approx(-3.3189291, rel=1e-7)
    np.testing.assert_allclose(
        found.stiffness,
        [[83.4995, 27.8332, 0], [27.8332, 83.4995, 0], [0, 0, 27.8332]],
        rtol=1e-5,
        atol=1e-6,
    )
    assert found.waves[0].speeds == pytest.approx((9.4663, 5.4654), abs=5e-5)
    rows = found.surfaces[0]
    assert rows.plane == "close-packed rows"
    assert 2 * rows.unrelaxed == pytest.approx(2.183, abs=5e-4)
    assert 2 * rows.relaxed == pytest.approx(2.182, abs=5e-4)


def test_silicon_relaxes_inside_its_cell() -> None:
    """Stillinger-Weber: a = 5.431, C11 = 151.4, C12 = 76.4, C44 = 56.4 GPa.

    Balamane, Halicioglu and Tiller, Phys. Rev. B 46, 2250 (1992), tables II and IV. Without inner
    relaxation C44 would be 117. The (111) surface as cut has one broken bond on each atom.
    """
    found = ask(
        Potential(
            structure="diamond",
            units="metal",
            pair_style="sw",
            pair_coeff=("* * Si.sw Si",),
            mass=28.0855,
        )
    )
    assert found.constant == pytest.approx(5.431, abs=5e-4)
    assert cubic(found) == pytest.approx((151.4, 76.4, 56.4), abs=0.1)
    broken = 2.16826 / 2 * 4 / (3**0.5 * found.constant**2) * 16021.77  # half a bond, on its area
    assert MJ * found.surfaces[0].unrelaxed == pytest.approx(broken, rel=1e-3)


def test_magnesium_has_two_lattice_constants() -> None:
    """Mg of Sun et al., Phys. Rev. B 73, 024116 (2006): a = 3.184 A, c/a = 1.628."""
    found = ask(
        Potential(
            structure="hcp", units="metal", pair_style="eam/fs", pair_coeff=("* * Mg_mm.eam.fs Mg",)
        )
    )
    assert found.constant == pytest.approx(3.184, abs=1e-3)
    assert found.ratio == pytest.approx(1.628, abs=1e-3)
    C = np.array(found.stiffness)
    assert C[5, 5] == pytest.approx(0.5 * (C[0, 0] - C[0, 1]), rel=5e-3)  # hexagonal symmetry


def test_the_cell_of_a_script(folder: Path) -> None:
    """A cell too wide by 1.5 %; its close-packed rows lie along x."""
    text = (folder / "cell.in").read_text().replace("1.1132013035564605", "1.13")
    (folder / "cell.in").write_text(text)
    found = answer(Question(script="cell.in"), MPI.COMM_SELF)
    assert found.factors == pytest.approx((1.1132013035564605 / 1.13,) * 2, rel=1e-9)
    assert (found.structure, found.constant) == (None, None)
    other = ask(LJ)
    assert found.energy == pytest.approx(other.energy)
    np.testing.assert_allclose(found.stiffness, other.stiffness, rtol=1e-6, atol=1e-6)
    assert found.surfaces[1].relaxed == pytest.approx(other.surfaces[0].relaxed, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"structure": "bcc"}, "bcc, pair_style lj/cut 2.5: the crystal is not stable"),
        ({"pair_style": "lj/cat 2.5"}, "lj/cat"),
        ({"units": "metal"}, "gives no mass of the atoms; give it with --mass"),
        ({"pair_coeff": ("* * 0 1",)}, "no crystal at zero pressure"),
    ],
)
def test_what_cannot_be_measured(changes: dict[str, object], words: str) -> None:
    plain = {name: getattr(LJ, name) for name in LJ.__struct_fields__}
    with pytest.raises(BackendError, match=words):
        ask(Potential(**(plain | changes)))
