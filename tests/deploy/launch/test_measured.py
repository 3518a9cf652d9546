"""What LAMMPS says of a case, filled into it; and what only LAMMPS can refuse."""

import msgspec
import pytest

from gimpmd_deploy.launch.asking import ask_lammps
from gimpmd_deploy.launch.measured import measured
from gimpmd_deploy.launch.reading import read_case
from gimpmd_schemas.case.form import Case, Elastic
from gimpmd_schemas.errors import InputError, PeerLostError
from gimpmd_schemas.grid.planes import interfaces_of
from gimpmd_schemas.wire.answers import Probe
from tests.cases import ATOMS, CASE, REMOVE, changed


def case(changes=None):
    return msgspec.convert(changed(CASE, changes or {}), Case)


def test_the_cutoff_of_lammps_is_filled_in(tmp_path):
    known = measured(case(), Probe(atoms=5, cutoff=2.5), tmp_path / "case.yaml")
    assert known.atoms.cutoff == 2.5


def test_another_cutoff_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"md\.cutoff = 2\.0.*differs"):
        measured(case({"md.cutoff": 2.0}), Probe(cutoff=2.5), tmp_path / "case.yaml")


MEASURED = {"continuum.material": {"from": "md", "cell": "bulk.in"}}


def test_a_measured_material_is_filled_in(tmp_path):
    elastic = Elastic(density=1.0, lame=27.0, shear=27.0)
    probe = Probe(cutoff=2.5, material=elastic)
    assert measured(case(MEASURED), probe, tmp_path / "case.yaml").material() == elastic


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (MEASURED, "did not measure a linear material"),
        ({"coupling.scheme": "force"}, "did not find a crystal and planes"),
    ],
)
def test_an_answer_that_lacks_something_is_an_error(tmp_path, changes, words):
    with pytest.raises(PeerLostError, match=words):
        measured(case(changes), Probe(cutoff=2.5), tmp_path / "case.yaml")


def test_crystal_and_planes_of_the_force_scheme(bench):
    """Atoms in the left half; rows along x at every 0.964, from a quarter of two rows on."""
    path = bench.write({"coupling.scheme": "force"})
    case = read_case(path)
    resolved = measured(case, ask_lammps(case, path), path)
    coupling = resolved.coupling
    assert (coupling.planes.left, coupling.planes.bottom, coupling.planes.top) == (None,) * 3
    half = 1.1132013035564605 / 2
    layers = (coupling.planes.right - half / 2) / half  # atoms at a/4 + n a/2
    assert abs(layers % 1.0 - 0.5) < 1e-9
    # at most a cell of 4 and a layer below the shallowest, which is at most a layer below 2.5
    assert 60.0 - 2.5 - 4.0 - 2.0 * half <= coupling.planes.right <= 57.5
    assert len(coupling.crystal.bonds) == len(coupling.crystal.energy) == 9
    assert interfaces_of(resolved)[0].core() == ((0.0, coupling.planes.right), (0.0, 80.0))


def test_the_velocity_scheme_and_a_run_of_one_side_need_none(bench):
    for changes, only in (({}, None), ({"coupling.scheme": "force"}, "md")):
        path = bench.write(changes)
        case = read_case(path, only=only)
        assert ask_lammps(case, path).crystal is None
        assert measured(case, ask_lammps(case, path), path).coupling == case.coupling


REGIONS = {"md.region": REMOVE, "md.regions": [[[0, 40], [0, 80]], [[72, 104], [20, 60]]]}


@pytest.mark.usefixtures("no_services")
@pytest.mark.parametrize(
    ("script", "changes", "words"),
    [
        ("units lj\ndimensoin 2\n", {}, ("ERROR", "dimensoin")),
        ("", {}, ("atoms.in",)),
        (None, {"time.md_timestep": 0.05, "time.md_steps": 1}, ("time.md_timestep", "at most")),
        (None, {"md.cutoff": 2.0}, ("md.cutoff", "2.5", "leave the key out")),
        (None, {"coupling.zones.outer": 2.0}, ("outer", "2.5", "at least")),
        (
            None,
            {"coupling": {"scheme": "force", "zones": {"outer": 2.0}}},
            ("coupling.zones.outer", "2.5", "at least"),
        ),
        (
            ATOMS + "region hole sphere 57 40 0 1 units box\ndelete_atoms region hole\n",
            {"coupling.scheme": "force"},
            ("no atom at (56.", "perfect", "set coupling.scheme: velocity"),
        ),
        (
            ATOMS.replace("lj/cut 2.5", "lj/cut 2.2271"),
            {"coupling.scheme": "force"},
            ("cross the cutoff", "set coupling.scheme: velocity"),
        ),
        (
            None,
            {**REGIONS, "coupling.scheme": "force"},
            ("in none of md.regions", "xlo1 xhi1 ylo1 yhi1"),
        ),
        (
            ATOMS.replace(
                "create_atoms 1 region box",
                """\
region one block ${xlo1} ${xhi1} ${ylo1} ${yhi1} -0.5 0.5 units box
region two block ${xlo2} ${xhi2} ${ylo2} ${yhi2} -0.5 0.5 units box
create_atoms 1 region one
lattice hex ${density} origin 0.5 0.25 0
create_atoms 1 region two""",
            ),
            {**REGIONS, "coupling.scheme": "force"},
            ("off the lattice of its neighbours", "set coupling.scheme: velocity"),
        ),
    ],
    ids=[
        "unknown command",
        "empty",
        "long MD step",
        "wrong cutoff",
        "narrow outer zone",
        "narrow ghost zone",
        "vacancy at the interface",
        "neighbours at the cutoff",
        "atoms between the regions",
        "another lattice in the second region",
    ],
)
def test_what_only_lammps_can_refuse(bench, script, changes, words):
    path = bench.write(changes, ATOMS if script is None else script)
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2, result.output
    for word in (str(path), *words):
        assert word in result.stderr, result.stderr
    assert "Traceback" not in result.output
    assert not bench.runs.exists()
