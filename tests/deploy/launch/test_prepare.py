"""What LAMMPS says of a case, in the resolved case file."""

from gimpmd_deploy.launch.prepare import ask_lammps, read_case, resolve
from gimpmd_schemas.case.load import dump_case, load_case
from gimpmd_schemas.grid.planes import interfaces_of


def test_crystal_and_planes_of_the_force_scheme(bench, tmp_path):
    """Atoms in the left half; rows along x at every 0.964, from a quarter of two rows on."""
    path = bench.write({"coupling.scheme": "force"})
    case = read_case(path)
    resolved = resolve(case, ask_lammps(case, path), path)
    coupling = resolved.coupling
    assert (coupling.planes.left, coupling.planes.bottom, coupling.planes.top) == (None,) * 3
    half = 1.1132013035564605 / 2
    layers = (coupling.planes.right - half / 2) / half  # atoms at a/4 + n a/2
    assert abs(layers % 1.0 - 0.5) < 1e-9
    # at most a cell of 4 and a layer below the shallowest, which is at most a layer below 2.5
    assert 60.0 - 2.5 - 4.0 - 2.0 * half <= coupling.planes.right <= 57.5
    assert len(coupling.crystal.bonds) == len(coupling.crystal.energy) == 9
    assert interfaces_of(resolved)[0].core() == ((0.0, coupling.planes.right), (0.0, 80.0))
    dump_case(resolved, tmp_path / "resolved.yaml")
    assert load_case(tmp_path / "resolved.yaml") == resolved


def test_the_velocity_scheme_and_a_run_of_one_side_need_none(bench):
    for changes, only in (({}, None), ({"coupling.scheme": "force"}, "md")):
        path = bench.write(changes)
        case = read_case(path, only=only)
        assert ask_lammps(case, path).crystal is None
        assert resolve(case, ask_lammps(case, path), path).coupling == case.coupling
