"""Bad input: one clear message, exit code 2, no service started, no run folder made."""

import os
from typing import Any

import pytest
import yaml

from tests.deploy.conftest import ATOMS, CASE, REMOVE, changed

NAN, INF = float("nan"), float("inf")

# changes to a sound case, and words that the message must hold: the key, and the way out
BROKEN: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "wrong type": ({"grid.cell": "wide"}, ("grid.cell", "'wide'", "number")),
    "unknown key": ({"grid.cel": 4}, ("grid.cel", "unknown key", "did you mean 'cell'?")),
    "unknown key at top": ({"contnuum": {}}, ("contnuum", "did you mean 'continuum'?")),
    "unknown key without likeness": ({"md.zzzz": 1}, ("md.zzzz", "known keys", "region")),
    "missing key": ({"time.end": REMOVE}, ("time.end", "missing")),
    "missing part": ({"output": REMOVE}, ("output", "missing")),
    "unknown units": ({"units": "ev"}, ("units", "'ev'", "'metal'")),
    "version of tomorrow": ({"gimpmd": 2}, ("gimpmd = 2", "must be 1")),
    "unknown material": (
        {"continuum.material": {"from": "book", "density": 1.0}},
        ("continuum.material", "book"),
    ),
    "negative density": (
        {"continuum.material.density": -1.0},
        ("continuum.material.density", "must be positive"),
    ),
    "no bulk stiffness": (
        {"continuum.material.lame": -30.0},
        ("continuum.material.lame", "must exceed -27.83"),
    ),
    "nan": ({"grid.cell": NAN}, ("grid.cell = nan", "must be a number")),
    "infinite": ({"time.end": INF}, ("time.end = inf", "must be a number")),
    "negative cell": ({"grid.cell": -4}, ("grid.cell", "must be positive")),
    "negative time step": ({"time.md_timestep": -0.002}, ("time.md_timestep", "must be positive")),
    "no MD steps": ({"time.md_steps": 0}, ("time.md_steps", "must be positive")),
    "no ranks": ({"md.ranks": 0}, ("md.ranks", "must be positive")),
    "upside-down domain": ({"domain.box": [[0, 120], [80, 0]]}, ("domain.box", "not above")),
    "box of one corner": (
        {"domain.box": [0, 120]},
        ("domain.box = [0, 120]", "[[number, number], [number, number]]"),
    ),
    "cell that does not divide": (
        {"grid.cell": 4.5},
        ("grid.cell", "does not divide the domain", "would"),
    ),
    "region outside": (
        {"md.region": [[0, 60], [0, 90]]},
        ("md.region", "leaves the domain along y", "inside the domain"),
    ),
    "region that fills the domain": (
        {"md.region": [[0, 120], [0, 80]]},
        ("md.region", "fills the domain", "--only md"),
    ),
    "region across a periodic axis": (
        {"domain.periodic": [False, True], "md.region": [[0, 60], [20, 60]]},
        ("md.region", "periodic axis y", "set it to [0, 80]"),
    ),
    "face of a periodic axis": (
        {"domain.periodic": [True, False], "md.region": [[0, 120], [0, 40]]},
        ("boundary.right.condition", "periodic axis", "leave it out"),
    ),
    "region close to the face": (
        {"md.region": [[0, 118], [0, 80]]},
        ("md.region", "right face", "move it away"),
    ),
    "zones wider than the region": (
        {"coupling.zones.inner": 60},
        ("coupling.zones", "do not fit the MD region along x", "widen md.region"),
    ),
    "thin inner zone": (
        {"coupling.zones.inner": 4},
        ("coupling.zones.inner", "narrower than four layers", "good choice"),
    ),
    "cutoff wider than the outer zone": (
        {"md.cutoff": 5.0},
        ("coupling.zones.outer", "cutoff 5", "make it at least 5"),
    ),
    "patches that do not tile": (
        {"md.ranks": 4, "md.patches": [3, 2]},
        ("md.patches", "3 x 2 = 6", "write auto"),
    ),
    "unstable continuum step": (
        {"time.md_steps": 400},
        ("time.md_steps", "unstable", "at most"),
    ),
    "integrator of whole steps": (
        {"continuum.integrator": "usavg"},
        ("continuum.integrator", "write auto or musl"),
    ),
    "negative ramp": ({"boundary.right.ramp": -1}, ("boundary.right.ramp", "not be negative")),
    "traction without value": (
        {"boundary.right": {"condition": "traction"}},
        ("boundary.right.value", "needs a value", "[0, 0.3]"),
    ),
    "value on a free face": (
        {"boundary.top": {"value": [0, 1]}},
        ("boundary.top.value", "takes no value", "leave it out"),
    ),
    "unknown condition": (
        {"boundary.top": {"condition": "glued"}},
        ("boundary.top.condition", "glued", "'symmetry'"),
    ),
    "missing script": (
        {"md.input": "atom.in"},
        ("md.input", "'atom.in'", "no such file", "looked for it in"),
    ),
    "missing table": ({"md.files": ["Cu.eam"]}, ("md.files[0]", "'Cu.eam'", "no such file")),
    "missing cell script": (
        {"continuum.material": {"from": "md", "cell": "bulk.in"}},
        ("continuum.material.cell", "'bulk.in'", "no such file"),
    ),
    "crack outside": (
        {"continuum.cracks": [{"from": [0, 40], "to": [400, 40]}]},
        ("continuum.cracks[0]", "leaves the domain"),
    ),
    "packet outside": (
        {"initial": {"packets": [{"center": 900, "wavelength": 30, "strain": 1e-4}]}},
        ("initial.packets[0].center", "is outside the domain"),
    ),
    "name that leaves the folder": ({"name": "../up"}, ("name = '../up'", "letters")),
    "no atoms": ({"md": REMOVE}, ("md: missing", "only: continuum")),
    "no MD time step": ({"time.md_timestep": REMOVE}, ("time.md_timestep", "missing")),
    "two time steps": (
        {"time.step": 0.1},
        ("time.step = 0.1", "determined by the atoms", "leave it out"),
    ),
    "three dimensions with atoms": (
        {"domain.box": [[0, 120], [0, 80], [0, 80]]},
        ("domain.box", "supported in two dimensions only", "--only continuum"),
    ),
    "vector of three components": (
        {"boundary.right.value": [0.1, 0, 0]},
        ("boundary.right.value", "must have 2 entries", "x, y"),
    ),
    "level off the node lines": (
        {"grid.levels": [{"boxes": [[[0, 102], [0, 80]]]}]},
        ("grid.levels[0].boxes[0]", "miss the node lines of level 0", "[0, 104] along x"),
    ),
    "level close to the rim": (
        {"grid.levels": [{"boxes": [[[0, 100], [8, 80]]]}]},
        ("grid.levels[0].boxes[0]", "does not lie inside a box of level 0", "leave 16"),
    ),
    "MD region out of the finest level": (
        {"grid.levels": [{"boxes": [[[0, 64], [0, 80]]]}]},
        ("grid.levels", "holds the MD region", "[0.0, 72.0], [0.0, 80.0]"),
    ),
    "stiffness that is none": (
        {"continuum.material": {"from": "stiffness", "density": 1, "stiffness": [[1, 2], [2, 1]]}},
        ("continuum.material.stiffness", "3 rows of 3 numbers", "xx, yy, xy"),
    ),
    "plane stress of a large strain": (
        {"continuum.material.plane": "stress", "continuum.material.model": "neo-hookean"},
        ("continuum.material.plane", "linear elasticity only"),
    ),
    "integrator for coupling": (
        {"continuum.integrator": "usl"},
        ("continuum.integrator", "velocity scheme", "write auto or musl"),
    ),
    "share above one": ({"continuum.flip": 1.5}, ("continuum.flip = 1.5", "between 0")),
    "force that atoms do not feel": (
        {"continuum.body_force": {"acceleration": [0, -1]}},
        ("continuum.body_force", "would not feel it", "--only continuum"),
    ),
    "history that goes back": (
        {"boundary.right": {"condition": "velocity", "value": [1, 0], "history": [[1, 0], [0, 1]]}},
        ("boundary.right.history", "do not increase"),
    ),
    "sudden displacement": (
        {"boundary.right": {"condition": "displacement", "value": [1, 0]}},
        ("boundary.right", "must be zero at the start", "give it a ramp"),
    ),
    "face that atoms do not know": (
        {"boundary.left": {"condition": "absorbing"}},
        ("boundary.left.condition", "not available for the atoms", "md.region off the face"),
    ),
    "face of the third dimension": (
        {"boundary.back": {"condition": "symmetry"}},
        ("boundary.back", "has no back face", "third pair"),
    ),
    "friction without contact": (
        {"continuum.cracks": [{"from": [0, 40], "to": [20, 40], "friction": 0.2}]},
        ("continuum.cracks[0].friction", "contact: frictional"),
    ),
    "zone of another scheme": (
        {"coupling": {"scheme": "force", "zones": {"inner": 12}}},
        ("coupling.zones.inner", "belongs to the velocity scheme", "leave it out"),
    ),
    "filter of another scheme": (
        {"coupling": {"scheme": "force", "filter_rate": 1}},
        ("coupling.filter_rate", "belongs to the velocity scheme", "coupling.scheme: velocity"),
    ),
    "points that stretch on a fixed grid": (
        {"coupling.scheme": "force", "continuum.interpolation": "cpgimp"},
        ("continuum.interpolation", "force scheme", "write ugimp or linear"),
    ),
    "patches of the continuum": (
        {"continuum.ranks": 4, "continuum.patches": [3, 1]},
        ("continuum.patches", "3 x 1 = 3", "write auto"),
    ),
}


@pytest.mark.usefixtures("no_services")
@pytest.mark.parametrize("name", BROKEN)
def test_broken_case_is_refused(bench, name):
    changes, words = BROKEN[name]
    path = bench.write(changes)
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2, result.output
    for word in (f"{path}: ", *words):
        assert word in result.stderr, result.stderr
    assert result.stderr.count("error:") == 1
    assert "Traceback" not in result.output
    assert not bench.runs.exists()


@pytest.mark.usefixtures("no_services")
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("is empty",)),
        ("- a\n- b\n", ("holds no keys",)),
        ("grid: {cell: 4\ntime: [", ("not valid YAML at line",)),
        ("gimpmd: 1\nname: a\nname: b\n", ("'name' appears twice", "line 3")),
        ("\0", ("yaml", "not valid YAML")),
    ],
    ids=["empty", "list", "not YAML", "duplicate key", "binary"],
)
def test_file_that_is_no_case(bench, text, words):
    path = bench.write()
    path.write_text(text)
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2
    for word in (str(path), *words):
        assert word in result.stderr
    assert not bench.runs.exists()


def test_missing_case(bench):
    result = bench.gimpmd("run", "nowhere.yaml")
    assert result.exit_code == 2
    assert "nowhere.yaml" in result.stderr
    assert "check the path" in result.stderr


def test_all_problems_at_once(bench):
    path = bench.write({"grid.cell": -1, "time.end": -2, "md.ranks": 0})
    result = bench.gimpmd("validate", path)
    assert result.exit_code == 2
    assert "3 problems" in result.stderr
    for key in ("grid.cell", "time.end", "md.ranks"):
        assert f"  - {key}" in result.stderr


def test_script_outside_the_case_folder(bench):
    path = bench.write({"md.input": "../atoms.in"})
    (bench.folder.parent / "atoms.in").write_text("units lj\n")
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2
    assert "md.input = '../atoms.in': lies outside the case's folder" in result.stderr
    assert "copy it there" in result.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--only", "foo"), ("--only", "'foo'", "md", "continuum")),
        (("--ranks-md", "0"), ("--ranks-md", "greater than or equal to 1")),
        (("--ranks-md", "two"), ("--ranks-md", "integer")),
        (("--colour", "red"), ("--colour",)),
    ],
)
def test_bad_options(bench, options, words):
    result = bench.gimpmd("run", bench.write(), *options)
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert not bench.runs.exists()


def test_more_gimp_ranks_than_it_can_use(bench):
    result = bench.gimpmd("run", bench.write(), "--ranks-gimp", 601)
    assert result.exit_code == 2
    assert "continuum.ranks = 601" in result.stderr
    assert "the 600 cells of level 0" in result.stderr


def test_ranks_that_do_not_fit_the_patches(bench):
    path = bench.write({"md.ranks": 2, "md.patches": [2, 1]})
    result = bench.gimpmd("run", path, "--ranks-md", 3)
    assert result.exit_code == 2
    assert "md.patches" in result.stderr
    assert "md.ranks = 3" in result.stderr


@pytest.mark.usefixtures("no_services")
def test_output_below_a_file(bench):
    path = bench.write()
    (bench.folder / "plain").write_text("")
    result = bench.gimpmd("run", path, "--out", "plain/run")
    assert result.exit_code == 2
    assert "plain is not a folder" in result.stderr
    assert "--out" in result.stderr


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_output_without_permission(bench):
    path = bench.write()
    (bench.folder / "locked").mkdir(mode=0o500)
    result = bench.gimpmd("run", path, "--out", "locked/run")
    assert result.exit_code == 2
    assert "no permission" in result.stderr


@pytest.mark.usefixtures("no_services")
def test_folder_in_use_is_left_alone(bench):
    path = bench.write()
    precious = bench.runs / "block" / "run.h5"
    precious.parent.mkdir(parents=True)
    precious.write_text("results of last week")
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2
    assert "not empty" in result.stderr
    assert "--force" in result.stderr
    assert precious.read_text() == "results of last week"


@pytest.mark.usefixtures("no_services")
def test_a_run_never_overwrites_its_own_case(bench):
    path = bench.write()
    before = path.read_text()
    result = bench.gimpmd("run", path, "--out", path.parent, "--force")
    assert result.exit_code == 2
    assert "the case itself lies there" in result.stderr
    assert path.read_text() == before


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


@pytest.mark.parametrize("command", ["report", "plot", "compare"])
def test_no_run_folder(bench, command):
    folders = [bench.folder] * (2 if command == "compare" else 1)
    result = bench.gimpmd(command, *folders)
    assert result.exit_code == 2
    assert "is no run folder" in result.stderr
    assert str(bench.folder) in result.stderr


def test_damaged_record(bench):
    run = bench.runs / "block"
    run.mkdir(parents=True)
    (run / "case.yaml").write_text(yaml.safe_dump(changed(CASE, {})))
    (run / "run.h5").write_bytes(b"not HDF5")
    result = bench.gimpmd("report", run)
    assert result.exit_code == 2
    assert "run.h5" in result.stderr
    assert "damaged" in result.stderr
