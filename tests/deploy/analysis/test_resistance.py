"""The resistance of a crack in a run, as LAMMPS measures it."""

from types import SimpleNamespace

import msgspec
import pytest

from gimpmd_deploy.analysis.crack import Crack
from gimpmd_deploy.analysis.resistance import crack_resistance
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import InputError
from tests.cases import CASE, changed
from tests.deploy.verify.crystal import BULK, MEASURED


def run_in(folder):
    (folder / "input").mkdir()
    (folder / "input" / "bulk.in").write_text(BULK)
    (folder / "input" / "atoms.in").write_text("")
    case = msgspec.convert(changed(CASE, {"continuum.material": MEASURED}), Case)
    return SimpleNamespace(case=case, folder=folder)


def test_close_packed_rows(tmp_path):
    run, crack = run_in(tmp_path), Crack.between((0, 5), (10, 5))
    assert crack_resistance(run, crack) == pytest.approx(2.182, abs=5e-4)
    assert crack_resistance(run, crack, relaxed=False) == pytest.approx(2.183, abs=5e-4)


def test_a_crack_across_the_axes(tmp_path):
    run = SimpleNamespace(case=None, folder=tmp_path)
    with pytest.raises(InputError, match="not normal to an axis"):
        crack_resistance(run, Crack.between((0, 0), (10, 5)))
