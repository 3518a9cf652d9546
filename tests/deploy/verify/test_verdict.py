"""What strips show, and the criterion."""

from __future__ import annotations

import pytest

from gimpmd_deploy.verify.strips import Wave
from gimpmd_deploy.verify.tasks import Task
from gimpmd_deploy.verify.verdict import Row, is_faithful, judge, shortest_faithful
from tests.deploy.verify.crystal import HEXAGONAL, ground


def test_the_criterion() -> None:
    assert is_faithful(0.03, 0.971, 0.021)
    assert not is_faithful(0.032, 1.0, 0.021)
    assert not is_faithful(0.0, 0.969, 0.0)
    assert not is_faithful(0.0, 1.031, 0.0)


def rows(faithful: dict[float, bool]) -> list[Row]:
    made = []
    for length, good in faithful.items():
        for travel, T in (("into", 1.0), ("out", 1.0 if good else 0.8)):
            made.append(
                Row(
                    wavelength=length,
                    polarization="P",
                    degrees=0.0,
                    travel="into" if travel == "into" else "out",
                    reflected=0.0,
                    transmitted=T,
                    grid_reflected=0.0,
                    grid_transmitted=1.0,
                    md_reflected=None,
                    md_transmitted=None,
                    faithful=is_faithful(0.0, T, 0.0),
                )
            )
    return made


@pytest.mark.parametrize(
    ("faithful", "shortest"),
    [
        ({6.0: False, 8.0: True, 20.0: True}, 8.0),
        ({6.0: True, 8.0: False, 20.0: True}, 20.0),
        ({6.0: True, 8.0: True, 20.0: False}, None),
        ({6.0: True}, 6.0),
    ],
)
def test_the_shortest_faithful_wavelength(
    faithful: dict[float, bool], shortest: float | None
) -> None:
    assert shortest_faithful(rows(faithful)) == shortest


def test_the_judgement_sets_each_wave_beside_the_grid() -> None:
    cut = ground(HEXAGONAL)
    wave = Wave(8.0, "P")
    shares = {
        Task(wave, "into"): (0.02, 1.0),
        Task(wave, "out"): (0.0, 0.7),
        Task(wave, "into", "continuum"): (0.02, 0.98),
    }
    verdict = judge(cut, shares)
    assert [(row.travel, row.faithful) for row in verdict.rows] == [("into", True), ("out", False)]
    assert verdict.shortest is None
    assert (verdict.cell, verdict.case_cell) == (cut.cell, 4.0)
