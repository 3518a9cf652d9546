"""The continuum's side: what a run of a material with history variables reports and writes."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan


def side_of(case: Case, folder: Path) -> ContinuumSide:
    """GIMP's side of a case."""
    plan = make_plan(case)
    return ContinuumSide(plan, Gimp(plan, None, folder))


def test_energies_and_output_of_a_plastic_body(build, tmp_path) -> None:
    """Kinetic, stored and dissipated energy are the external work; history variables are output."""
    moduli = {"density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0}
    case = build(
        domain={"box": [[0.0, 24.0], [0.0, 2.0]], "periodic": [False, True]},
        md=None,
        time={"end": 40.0, "step": 0.2},
        continuum={
            "material": {"from": "j2", "yield_stress": 0.01, "hardening": 0.1} | moduli,
            "configuration": "reference",
        },
        boundary={"left": {"condition": "traction", "value": [0.03, 0.0], "ramp": 10.0}},
    )
    (tmp_path / "fields").mkdir()
    side = side_of(case, tmp_path)
    for _ in range(150):
        side.finish()
        side.receive({})
        side.advance()
    side.finish()
    energies = side.energies()
    side.write(30.0)
    side.close()
    assert energies.dissipated > 0.1 * energies.external_work
    total = energies.kinetic + energies.potential + energies.dissipated
    assert total == pytest.approx(energies.external_work, rel=1e-4)
    with h5py.File(tmp_path / "fields" / "points.vtkhdf") as file:
        data = {name: data[:] for name, data in file["VTKHDF/PointData"].items()}
    count = len(data["velocity"])
    assert data["plastic_strain"].shape == (count, 4)
    assert data["equivalent_plastic_strain"].shape == (count,)
    np.testing.assert_allclose(data["plastic_strain"][:, :3].sum(axis=1), 0.0, atol=1e-15)
    dissipated = 0.01 * data["equivalent_plastic_strain"].sum() * 24.0 * 2.0 / count
    assert energies.dissipated == pytest.approx(dissipated, rel=1e-12)
    stored = data["strain_energy"].sum() * 24.0 * 2.0 / count
    assert energies.potential == pytest.approx(stored, rel=1e-12)
    yields = data["equivalent_plastic_strain"] > 0.0
    assert yields.any()
    # von Mises stress with tau_zz = lame tr(eps) - 2 mu eps_p_zz, on the yield surface or within
    eps, plastic = data["strain"], data["plastic_strain"]
    zz = (eps[:, 0] + eps[:, 1]) / 3.0 - 2.0 / 3.0 * plastic[:, 2]
    tau = data["stress"]
    mean = (tau[:, 0] + tau[:, 1] + zz) / 3.0
    square = (tau[:, 0] - mean) ** 2 + (tau[:, 1] - mean) ** 2 + (zz - mean) ** 2
    square += 2.0 * tau[:, 2] ** 2
    most = 0.01 + 0.1 * data["equivalent_plastic_strain"]
    assert (np.sqrt(1.5 * square) <= most * (1.0 + 1e-9)).all()


def test_elastic_bodies_have_no_fields_of_history(build, tmp_path) -> None:
    (tmp_path / "fields").mkdir()
    side = side_of(build(), tmp_path)
    side.finish()
    side.write(0.0)
    side.close()
    assert side.energies().dissipated == 0.0
    with h5py.File(tmp_path / "fields" / "points.vtkhdf") as file:
        names = set(file["VTKHDF/PointData"])
    assert names == {
        *("reference", "displacement", "velocity", "strain", "stress", "zone", "level", "size"),
        *("displacement_gradient", "strain_energy", "mass"),
    }
