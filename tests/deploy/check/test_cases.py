"""The bodies of a check."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from gimpmd_deploy.check.cases import BLOCK, BODIES, STRIP, Checkup, prepare
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.errors import InputError
from tests.cases import changed


def test_the_built_in_strip_needs_no_lammps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimpmd_deploy.check.cases.ask", None)
    plan = prepare(STRIP, Checkup("continuum", "fem"), False, tmp_path / "strip")
    assert plan == load_plan(tmp_path / "strip" / "plan.yaml")
    assert plan.continuum.backend == "fem"
    assert plan.coupled.scheme == "force"
    assert plan.coupled.interfaces[0].planes[0] == (23.0, 46.0)


def test_the_built_in_block_is_free_and_alone(tmp_path: Path) -> None:
    plan = prepare(BLOCK, Checkup("continuum"), True, tmp_path / "block")
    assert (plan.only, plan.coupling, plan.domain.periodic) == ("continuum", None, (False, False))


def test_lammps_measures_the_crystal_of_an_md_service(tmp_path: Path) -> None:
    """It has the lattice constant 1, and rests without pressure; the bonds reach to the cutoff."""
    plan = prepare(STRIP, Checkup("md"), False, tmp_path / "strip")
    crystal = plan.coupled.crystal
    assert crystal is not None
    assert crystal.vectors[0] == pytest.approx((1.0, 0.0))
    assert len(crystal.bonds) > 3
    assert (tmp_path / "strip" / "input" / "crystal.in").is_file()


def test_ranks_of_the_service_and_of_its_peers(tmp_path: Path) -> None:
    plan = prepare(STRIP, Checkup("continuum", ranks=2, peers=3), False, tmp_path / "strip")
    assert (plan.ranks("continuum"), plan.ranks("md")) == (2, 3)


def test_the_levels_lie_beside_the_atoms(tmp_path: Path) -> None:
    plan = prepare(BODIES["levels"][0], Checkup("continuum"), False, tmp_path / "levels")
    (low, high), _ = plan.level_boxes[1][0]
    (planes, _), (start, end) = plan.coupled.interfaces[0].planes, plan.domain.box[0]
    assert start < low < planes[0] < planes[1] < high < end
    assert plan.steps_together == 2
    free = prepare(BODIES["levels"][1], Checkup("continuum"), True, tmp_path / "free")
    assert len(free.level_cells) == 2


@pytest.mark.long
def test_the_body_in_space_has_other_lengths_along_y_and_z(tmp_path: Path) -> None:
    plan = prepare(BODIES["space"][0], Checkup("continuum"), False, tmp_path / "space")
    assert plan.coupled.scheme == "sites"
    assert plan.coupled.sites is not None
    assert plan.background_grid().cells == (16, 2, 3)


def test_a_scheme_that_is_not_checked(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    changes = {"coupling": {"scheme": "velocity"}}
    path.write_text(yaml.safe_dump(changed(yaml.safe_load(STRIP.read_text()), changes)))
    with pytest.raises(InputError, match=r"coupling\.scheme = 'velocity': is not"):
        prepare(path, Checkup("continuum"), False, tmp_path / "strip")
    assert not (tmp_path / "strip").exists()
