"""The lowest mode of a case as a run looks at it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.coupling.sites import modes
from gimpmd_gimp.coupling.sites.layout import lay_out
from gimpmd_gimp.coupling.sites.modes import check_modes, lowest_modes
from gimpmd_gimp.coupling.sites.terms import terms_at_rest
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire.stiffness import Stiffness
from tests.copper_sites import COPPER, SILICON, Metal, copper_case, write_scripts
from tests.measuring import measured
from tests.services.gimp.coupling.sites.crystals import copper, lennard_jones
from tests.services.gimp.coupling.sites.interfaces import Setup, by_the_rule, silicon
from tests.services.gimp.coupling.sites.test_correction import BOX, L
from tests.services.md.test_stiffness import SCRIPT_OF_TWO, TWO, stiffness_of
from tests.sites_case import measured_case


@pytest.mark.parametrize("softer", [1.0, 100.0])
@pytest.mark.parametrize("boxes", [BOX, L], ids=["box", "L"])
def test_modes_are_those_of_a_dense_solver(boxes: list[Box], softer: float) -> None:
    """With a correction a hundred times as strong the lowest have negative stiffness."""
    setup = by_the_rule(lennard_jones(), 3.856, boxes)
    stronger = replace(setup.correction, dA=softer * setup.correction.dA)
    setup.__dict__["correction"] = stronger
    K, x = setup.energy()
    exact, vectors = np.linalg.eigh(K.toarray())
    # of several modes without stiffness some may be missing where others are far below them
    found, number = lowest_modes(K, x, 6), 6 if softer == 1.0 else 2
    exact /= exact[-1]
    np.testing.assert_allclose(found.values[:number], exact[:number], rtol=1e-9, atol=1e-13)
    assert (exact[0] < -1e-2) == (softer > 1.0)
    if softer > 1.0:
        np.testing.assert_allclose(abs(found.vectors[:, 0] @ vectors[:, 0]), 1.0, rtol=1e-6)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Stiffness]:
    folder = tmp_path_factory.mktemp("small")
    case = measured_case(folder)
    return make_plan(case), stiffness_of(case, folder)


def by_formulas(setup: Setup) -> float:
    """The lowest mode that is no rigid motion, of a set-up of the tests of the statics."""
    values = np.linalg.eigvalsh(setup.hessian())
    return float(values[values > 1e-8 * values[-1]][0] / values[-1])


def test_the_lowest_mode_of_a_case_is_that_by_formulas(small: tuple[Plan, Stiffness]) -> None:
    """Of lattice sums with the same planes; the case gives C11 with seven digits."""
    plan, atoms = small
    layout = lay_out(plan)
    setup = Setup(lennard_jones(), plan.finest_cell, layout.shells)
    found = check_modes(plan, layout, atoms)
    assert found.freedoms == len(setup.hessian())
    assert found.stiffness == pytest.approx(by_formulas(setup), rel=1e-6)


def test_a_set_up_with_a_correction_that_is_too_soft_is_refused(
    small: tuple[Plan, Stiffness], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, atoms = small

    def softer(*given):  # type: ignore[no-untyped-def]
        terms = terms_at_rest(*given)
        return replace(terms, dA=100.0 * terms.dA)

    monkeypatch.setattr(modes, "terms_at_rest", softer)
    where = r"md\.region = \[\[.*\]\]: the set-up is not stable: atoms and nodes near \(.*\)"
    with pytest.raises(
        BackendError, match=where + r".*, -\d\.\de-0\d of the largest; move"
    ) as raised:
        check_modes(plan, lay_out(plan), atoms)
    assert raised.value.exit_code == 2


def test_the_region_of_a_mode_is_named(tmp_path: Path) -> None:
    """Of two; with a continuum that is much softer than the crystal the corrections win."""
    soft = {"from": "moduli", "density": 0.9317984, "lame": 0.05, "shear": 0.05}
    case = measured_case(tmp_path, SCRIPT_OF_TWO, **TWO, **{"continuum.material": soft})
    plan, atoms = make_plan(case), stiffness_of(case, tmp_path)
    with pytest.raises(BackendError, match=r"md\.regions\[\d\] = .* near \(") as raised:
        check_modes(plan, lay_out(plan), atoms)
    said = re.search(r"\[(\d)\] = .* near \((\S+), (\S+)\) have", str(raised.value))
    assert said is not None
    region = plan.coupled.interfaces[int(said[1])].region
    for (low, high), place in zip(region, map(float, said.groups()[1:]), strict=True):
        assert low < place < high


def test_too_many_freedoms_are_not_looked_at(
    small: tuple[Plan, Stiffness], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, atoms = small
    freedoms = check_modes(plan, lay_out(plan), atoms).freedoms
    monkeypatch.setattr(modes, "MOST", {2: freedoms - 1})
    found = check_modes(plan, lay_out(plan), atoms)
    assert (found.freedoms, found.stiffness) == (freedoms, None)


@pytest.mark.long
@pytest.mark.parametrize("metal", [COPPER, SILICON])
def test_lowest_modes_of_columns_are_those_by_formulas(metal: Metal, tmp_path: Path) -> None:
    """They repeat along y after two cells. The stiffness of silicon here is that by LAMMPS too."""
    write_scripts(tmp_path, metal)
    region = (2.3, 9.3), None, (2.4, 9.5)
    case = measured(msgspec.convert(copper_case((12, 2, 12), region, 0.1, metal), Case), tmp_path)
    plan = make_plan(case)
    layout = lay_out(plan)
    found = check_modes(plan, layout, stiffness_of(case, tmp_path))
    if metal is COPPER:
        setup = Setup(copper(), plan.finest_cell, layout.shells, rounds={1: 2})
        assert found.stiffness == pytest.approx(by_formulas(setup), rel=1e-5)
        return
    with silicon(tmp_path) as (made, _):
        like = made(None, plan.finest_cell, [((-5.0, 5.0),) * 3])
        setup = replace(like, shells=layout.shells, rounds={1: 2})
        assert found.stiffness == pytest.approx(by_formulas(setup), rel=1e-5)
