"""Bad input: one clear message, exit code 2, no service started, no run folder made."""

from typing import Any

import pytest

from gimpmd_deploy.launch.reading import read_case
from tests.cases import REMOVE

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
    "three dimensions with atoms and continuum": (
        {"domain.box": [[0, 120], [0, 80], [0, 80]]},
        ("domain.box", "only the sites scheme couples", "--only md or --only continuum"),
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
@pytest.mark.parametrize(("role", "installed"), [("md", "ase, lammps"), ("continuum", "fem, gimp")])
def test_a_code_that_is_not_installed(bench, role, installed):
    path = bench.write({f"{role}.backend": "none"})
    for command in ("validate", "run"):
        result = bench.gimpmd(command, path)
        assert result.exit_code == 2
        problem = f"{role}.backend = 'none': no such code is installed (installed: {installed})"
        for words in (f"{path}: 1 problem", problem, f"in its entry points 'gimpmd.{role}'"):
            assert words in result.stderr
    assert not bench.runs.exists()


def test_the_code_of_a_side_that_takes_no_part_need_not_be_installed(bench):
    case = read_case(bench.write({"md.backend": "none"}), only="continuum")
    assert case.atoms.backend == "none"
