"""The monitors of the continuum: strains of points, and the sums of the side."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gimpmd_gimp.coupling.monitors import Monitors, largest_strain
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.energies import Energies


def monitors(case: Case, F: np.ndarray, comm: Any = None, **law: Any) -> Monitors:
    """Monitors of points in a row that have the deformation gradients F."""
    x = np.arange(2.0 * len(F)).reshape(-1, 2)
    solver = SimpleNamespace(
        comm=comm,
        law=SimpleNamespace(**{"finite": False, "trusted_strain": 0.1} | law),
        deformation=lambda: (F, x),
    )
    return Monitors(make_plan(case), solver)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("finite", [False, True])
def test_the_largest_strain(d: int, finite: bool) -> None:
    F = np.eye(d) + np.random.default_rng(1).normal(0.0, 0.1, (50, d, d))
    if finite:
        strain = 0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(d))
    else:
        strain = 0.5 * (np.swapaxes(F, 1, 2) + F) - np.eye(d)
    norm = np.linalg.norm(strain, axis=(1, 2))
    value, point = largest_strain(F, finite)
    assert value == pytest.approx(norm.max())
    assert point == norm.argmax()


def test_a_rotation_is_no_finite_strain() -> None:
    c, s = np.cos(1.0), np.sin(1.0)
    assert largest_strain(np.array([[[c, -s], [s, c]]]), True)[0] == pytest.approx(0.0, abs=1e-15)


def test_a_strain_that_is_no_number_is_the_largest() -> None:
    F = np.tile(np.eye(2), (3, 1, 1))
    F[1, 0, 0] = np.nan
    F[2, 0, 0] = 9.0
    value, point = largest_strain(F, False)
    assert np.isnan(value)
    assert point == 1


def test_a_point_strained_beyond_the_reach_of_its_law(build) -> None:
    F = np.tile(np.eye(2), (3, 1, 1))
    F[1, 0, 0] = 1.09
    assert monitors(build(), F).look_at_points() == ()
    (found,) = monitors(build(), F, trusted_strain=0.08).look_at_points()
    assert (found.kind, found.limit, found.place) == ("strain", 0.08, (2.0, 3.0))
    assert found.value == pytest.approx(0.09)


def test_a_rank_without_points(build) -> None:
    assert monitors(build(), np.zeros((0, 2, 2))).look_at_points() == ()


def test_the_first_rank_tells_of_the_sums_of_all(build) -> None:
    def energies(mass: float) -> Energies:
        return Energies(
            kinetic=0.0,
            potential=0.0,
            external_work=0.0,
            interface_work=0.0,
            dissipated=0.0,
            mass=mass,
            momentum=(0.0, 0.0),
        )

    for rank, kinds in ((0, ["mass"]), (1, [])):
        comm = SimpleNamespace(rank=rank, allgather=lambda one: [one, energies(1.0)])
        of_rank = monitors(build(), np.zeros((0, 2, 2)), comm)
        assert of_rank.look_at_sums(energies(1.0)) == ()
        assert [f.kind for f in of_rank.look_at_sums(energies(0.9))] == kinds


def test_they_go_on_from_their_state(build) -> None:
    def energies(potential: float) -> Energies:
        return Energies(
            kinetic=0.0,
            potential=potential,
            external_work=potential,
            interface_work=0.0,
            dissipated=0.0,
            mass=1.0 + potential,
            momentum=(0.0, 0.0),
        )

    first, second = (monitors(build(), np.zeros((0, 2, 2))) for _ in range(2))
    first.look_at_sums(energies(0.0))
    second.restore(first.state())
    assert [f.kind for f in second.look_at_sums(energies(0.1))] == ["mass"]
