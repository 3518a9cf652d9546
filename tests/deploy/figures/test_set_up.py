"""The set-up of a case."""

import msgspec
import pytest

from gimpmd_deploy.figures.set_up import draw_set_up
from gimpmd_schemas.case.form import Case
from tests.cases import BLOCK_3D, CASE, changed


@pytest.mark.parametrize(
    "changes",
    [
        {"grid.levels": [{"boxes": [[[0, 72], [0, 80]]]}]},
        {"coupling.scheme": "force", "boundary.top": {"condition": "symmetry"}},
        {"continuum.cracks": [{"from": [80, 40], "to": [120, 40]}]},
        BLOCK_3D,
    ],
    ids=["levels", "force scheme", "crack", "three dimensions"],
)
def test_set_up_is_drawn(tmp_path, changes):
    picture = tmp_path / "setup.png"
    draw_set_up(msgspec.convert(changed(CASE, changes), Case), picture)
    assert picture.stat().st_size > 10_000
