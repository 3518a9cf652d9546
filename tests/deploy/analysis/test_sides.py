"""Every place of the body counts on one side."""

from types import SimpleNamespace

import numpy as np

from gimpmd_deploy.analysis.sides import counted
from gimpmd_schemas.grid.zones import MdRegion, Zones

X = np.stack([np.linspace(-5, 15, 81), np.zeros(81)], axis=1)


def test_the_energy_plane_divides_a_coupled_body():
    region = MdRegion(((0.0, 20.0), (-9.0, 9.0)), ((True, True), (False, False)))
    plan = SimpleNamespace(coupling=SimpleNamespace(zones=Zones((region,), 4.0, 2.0, 8.0, 0.0)))
    deep = counted(plan, "md", X)
    assert (deep == (X[:, 0] >= 5.0)).all()
    assert (counted(plan, "continuum", X) == ~deep).all()


def test_all_count_in_a_run_of_one_side():
    plan = SimpleNamespace(coupling=None)
    assert counted(plan, "md", X).all()
    assert counted(plan, "continuum", X).all()
