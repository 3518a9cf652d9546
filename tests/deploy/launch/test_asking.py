"""Questions to the MD service."""

import subprocess
import sys
import tempfile
import time

import msgspec
import psutil
import pytest

from gimpmd_deploy.launch import asking
from gimpmd_deploy.launch.asking import ask_lammps, ask_repeat, ask_surfaces, needs_lammps
from gimpmd_deploy.launch.reading import read_case
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.resolve import resolve
from tests.cases import ATOMS, CASE, CONTINUUM_ONLY, changed
from tests.deploy.verify.crystal import BULK, HEXAGONAL, MEASURED


def test_a_continuum_with_given_moduli_needs_no_lammps():
    assert needs_lammps(msgspec.convert(CASE, Case))
    assert not needs_lammps(msgspec.convert(changed(CASE, CONTINUUM_ONLY), Case))


def test_atoms_and_cutoff(bench):
    path = bench.write()
    probe = ask_lammps(read_case(path), path)
    assert probe.atoms == pytest.approx(60 * 80 / 1.0731935, rel=0.02)
    assert probe.cutoff == 2.5
    assert probe.crystal is None


def test_the_period_of_a_crystal(bench):
    path = bench.write({"continuum.material": MEASURED})
    (path.parent / "bulk.in").write_text(BULK)
    repeat = ask_repeat(read_case(path), path)
    assert repeat.period == pytest.approx(HEXAGONAL)
    assert repeat.size == pytest.approx((3 * HEXAGONAL[0], 2 * HEXAGONAL[1]))


def test_surface_energies(bench):
    path = bench.write({"continuum.material": MEASURED})
    (path.parent / "bulk.in").write_text(BULK)
    surfaces = ask_surfaces(read_case(path), path)
    assert 2 * surfaces.unrelaxed[1] == pytest.approx(2.183, abs=5e-4)  # lattice sum


def test_words_of_lammps(bench):
    path = bench.write(script="units lj\ndimensoin 2\n")
    with pytest.raises(BackendError, match=r"case\.yaml: .*dimensoin"):
        ask_lammps(read_case(path), path)


def test_a_script_that_does_not_end(bench, monkeypatch):
    monkeypatch.setattr(asking, "PROBE_DEADLINE", 0.1)
    path = bench.write()
    with pytest.raises(PeerLostError, match=r"did not finish atoms\.in within"):
        ask_lammps(read_case(path), path)


@pytest.mark.parametrize(("scheme", "seconds"), [("sites", 1800.0), ("force", 120.0)])
def test_sites_near_the_planes_take_longer(bench, monkeypatch, scheme, seconds):
    given = []

    def helper(*_, **words):
        given.append(words["seconds"])
        return "nothing"

    monkeypatch.setattr(asking, "run_helper", helper)
    path = bench.write({"coupling.scheme": scheme})
    with pytest.raises(PeerLostError, match="no valid answer"):
        ask_lammps(read_case(path), path)
    assert given == [seconds]


def test_crystal_and_planes_of_the_force_scheme(bench):
    """Atoms in the left half; rows along x at every 0.964, from a quarter of two rows on."""
    path = bench.write({"coupling.scheme": "force"})
    case = read_case(path)
    probe = ask_lammps(case, path)
    assert (probe.planes.left, probe.planes.bottom, probe.planes.top) == (None,) * 3
    half = 1.1132013035564605 / 2
    layers = (probe.planes.right - half / 2) / half  # atoms at a/4 + n a/2
    assert abs(layers % 1.0 - 0.5) < 1e-9
    # at most a cell of 4 and a layer below the shallowest, which is at most a layer below 2.5
    assert 60.0 - 2.5 - 4.0 - 2.0 * half <= probe.planes.right <= 57.5
    assert len(probe.crystal.bonds) == len(probe.crystal.energy) == 9
    assert resolve(case, probe, path).coupled.interfaces[0].core() == (
        (0.0, probe.planes.right),
        (0.0, 80.0),
    )


def test_the_velocity_scheme_and_a_run_of_one_side_need_none(bench):
    for changes, only in (({}, None), ({"coupling.scheme": "force"}, "md")):
        path = bench.write(changes)
        probe = ask_lammps(read_case(path, only=only), path)
        assert (probe.crystal, probe.planes) == (None, None)


def test_quit_in_a_script_is_named(bench):
    path = bench.write(script=ATOMS + 'if "2 > 1" then quit\n')
    with pytest.raises(BackendError, match=r"case\.yaml: atoms\.in: the command quit ended LAMMPS"):
        ask_lammps(read_case(path), path)


@pytest.mark.parametrize("end", ["SIGTERM", "SIGKILL", "SIGTERM of gimpmd"])
def test_a_probe_that_is_ended_early_leaves_no_folder(bench, monkeypatch, tmp_path, end):
    """The script goes on for ever, after the probe has made its own temporary folder."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    path = bench.write(script=ATOMS + "shell touch started\nlabel again\njump SELF again\n")
    words = [sys.executable, "-m", "gimpmd_deploy.cli.app", "validate", "--probe", str(path)]
    gimpmd = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    while not list(temporary.rglob("started")):
        assert gimpmd.poll() is None
        time.sleep(0.05)
    family = psutil.Process(gimpmd.pid).children(recursive=True)
    assert len(list(temporary.glob("*"))) > 1
    if end == "SIGKILL":
        family[0].kill()
    elif end == "SIGTERM":
        family[0].terminate()
    else:
        gimpmd.terminate()
    said = gimpmd.communicate(timeout=60)[0].decode()
    assert gimpmd.returncode == (5 if end == "SIGTERM of gimpmd" else 3), said
    assert "Traceback" not in said
    assert list(temporary.iterdir()) == []
    assert not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in family)
