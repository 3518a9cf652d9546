"""From a case and what LAMMPS has measured to a plan."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case, Crystal, Planes
from gimpmd_schemas.case.materials import Elastic, Hyperelastic
from gimpmd_schemas.errors import InputError, PeerLostError
from gimpmd_schemas.resolve import resolve
from gimpmd_schemas.wire.answers import Probe
from tests.schemas.case.test_plan import CRYSTAL

Make = Callable[..., Case]
PATH = Path("plate/case.yaml")
MEASURED = {"from": "md", "cell": "cell.in"}
MATERIAL = Elastic(density=0.93, lame=27.8, shear=27.8)


def force(make: Make, **changes: Any) -> Case:
    return make(coupling__scheme="force", continuum__material=MEASURED, **changes)


def probe(**changes: Any) -> Probe:
    found = Probe(
        atoms=4000,
        cutoff=2.5,
        spacing=1.1132,
        material=MATERIAL,
        crystal=msgspec.convert(CRYSTAL, Crystal),
        planes=Planes(right=70.0, bottom=30.0, top=50.0),
    )
    return msgspec.structs.replace(found, **changes)


def test_what_lammps_measures_is_filled_in(make: Make) -> None:
    plan = resolve(force(make), probe(), PATH)
    assert plan.continuum.material == MATERIAL
    assert plan.atoms.cutoff == 2.5
    assert plan.coupled.crystal == probe().crystal
    assert plan.coupled.interfaces[0].core() == ((0.0, 70.0), (30.0, 50.0))


def test_a_case_that_needs_no_lammps_needs_no_answer(make: Make) -> None:
    assert resolve(make(), Probe(), PATH).atoms.cutoff is None


def test_another_cutoff_than_that_of_lammps_is_bad_input(make: Make) -> None:
    with pytest.raises(InputError, match=r"md\.cutoff = 3\.0: .*2\.5\n.*write 2\.5") as caught:
        resolve(force(make, md__cutoff=3.0), probe(), PATH)
    assert str(PATH) in str(caught.value)
    resolve(force(make, md__cutoff=2.5), probe(), PATH)


def test_zones_narrower_than_the_measured_cutoff_are_bad_input(make: Make) -> None:
    with pytest.raises(InputError, match=r"coupling\.zones\.outer"):
        resolve(make(), probe(cutoff=9.0), PATH)


def test_a_time_step_too_long_for_the_measured_lattice_is_bad_input(make: Make) -> None:
    with pytest.raises(InputError, match=r"time\.md_timestep"):
        resolve(make(time__md_timestep=0.05, time__md_steps=1), probe(), PATH)


@pytest.mark.parametrize("missing", ["crystal", "planes"])
def test_a_missing_interface_is_the_services_fault(make: Make, missing: str) -> None:
    with pytest.raises(PeerLostError, match="no crystal and no planes"):
        resolve(force(make), probe(**{missing: None}), PATH)


@pytest.mark.parametrize(
    "found",
    [None, Hyperelastic(density=1, lame=1, shear=1, coefficients=(), strain_limit=0.1)],
    ids=["nothing", "another model"],
)
def test_a_missing_material_is_the_services_fault(make: Make, found: Hyperelastic | None) -> None:
    with pytest.raises(PeerLostError, match="measured no linear material"):
        resolve(force(make), probe(material=found), PATH)
