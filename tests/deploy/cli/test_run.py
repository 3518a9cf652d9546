"""What ``gimpmd run`` leaves and says; tests/system looks at whole runs more closely."""

import h5py

from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan
from tests.cases import ATOMS


def test_run_folder_is_complete(runs):
    run = runs / "block"
    assert load_plan(run / "plan.yaml").atoms.cutoff == 2.5  # what LAMMPS said
    assert load_case(run / "case.yaml").name == "block"
    assert (run / "input" / "atoms.in").read_text() == ATOMS
    for name in ("run.h5", "fields/points.vtkhdf", "atoms/atoms.dump", "logs/md.log"):
        assert (run / name).stat().st_size > 0
    with h5py.File(run / "run.h5") as file:
        assert file.attrs["outcome"] == "completed"
        assert file["series/step"][-1] == 10
