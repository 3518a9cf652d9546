"""The bodies of a check."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from gimpmd_deploy.check.cases import BLOCK, STRIP, prepare
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.errors import InputError
from tests.cases import changed


def test_the_built_in_strip_needs_no_lammps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimpmd_deploy.check.cases.ask", None)
    plan = prepare(STRIP, "continuum", "fem", False, tmp_path / "strip")
    assert plan == load_plan(tmp_path / "strip" / "plan.yaml")
    assert plan.continuum.backend == "fem"
    assert plan.coupled.scheme == "force"
    assert plan.coupled.interfaces[0].planes[0] == (23.0, 46.0)


def test_the_built_in_block_is_free_and_alone(tmp_path: Path) -> None:
    plan = prepare(BLOCK, "continuum", None, True, tmp_path / "block")
    assert (plan.only, plan.coupling, plan.domain.periodic) == ("continuum", None, (False, False))


def test_lammps_measures_the_crystal_of_an_md_service(tmp_path: Path) -> None:
    """It has the lattice constant 1, and rests without pressure; the bonds reach to the cutoff."""
    plan = prepare(STRIP, "md", None, False, tmp_path / "strip")
    crystal = plan.coupled.crystal
    assert crystal is not None
    assert crystal.vectors[0] == pytest.approx((1.0, 0.0))
    assert len(crystal.bonds) > 3
    assert (tmp_path / "strip" / "input" / "crystal.in").is_file()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"coupling": {"scheme": "velocity"}}, "coupling.scheme = 'velocity': is not checked"),
        (
            {"grid.levels": [{"boxes": [[[0, 34], [0, 6.9]]]}]},
            "grid.levels: is not checked",
        ),
    ],
    ids=["scheme", "levels"],
)
def test_cases_that_are_not_checked(tmp_path: Path, changes: dict[str, object], key: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(changed(yaml.safe_load(STRIP.read_text()), changes)))
    with pytest.raises(InputError, match=key):
        prepare(path, "continuum", None, False, tmp_path / "strip")
    assert not (tmp_path / "strip").exists()
