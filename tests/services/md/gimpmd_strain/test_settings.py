"""Which strain to compute: defaults, and what is refused before anything is read."""

from __future__ import annotations

import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_strain.background import GridOptions
from gimpmd_strain.settings import CELL, Settings
from gimpmd_strain.virial import CUTOFF


def test_lengths_follow_from_the_distance_of_neighbours() -> None:
    found = Settings().resolved(1.1)
    assert (found.spacing, found.cell) == (1.1, pytest.approx(CELL * 1.1))
    assert found.cutoff == pytest.approx(CUTOFF * 1.1)
    assert found.grid() == GridOptions(found.cell, 1.1, "linear")


def test_given_lengths_stay() -> None:
    given = Settings("total", cell=4.0, spacing=0.9, weights="gimp", measure="green", cutoff=2.0)
    assert given.resolved(1.1) == given
    assert given.grid() == GridOptions(4.0, 0.9, "gimp")
    wide = Settings(spacing=5.0).resolved(1.0)  # the cell has to hold an atom
    assert (wide.cell, wide.spacing) == (5.0, 5.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"method": "viral"},
            "method = 'viral': is unknown\n      one of incremental, total, virial",
        ),
        ({"weights": "cubic"}, "weights = 'cubic': is unknown"),
        ({"method": "total", "measure": "log"}, "measure = 'log': is unknown"),
        ({"cell": 0.0}, "cell = 0.0: is not a length"),
        ({"spacing": float("nan")}, "spacing = nan: is not a length"),
        ({"cutoff": float("inf")}, "cutoff = inf: is not a length"),
        ({"measure": "green"}, "measure = 'green': is for the method total only"),
        ({"method": "virial", "measure": "almansi"}, "for the method total only"),
    ],
)
def test_one_problem_is_one_message(options, words) -> None:
    with pytest.raises(InputError, match="atomic strain: 1 problem\n") as told:
        Settings(**options)
    assert words in str(told.value)


def test_all_problems_are_listed_together() -> None:
    with pytest.raises(InputError) as told:
        Settings(method="viral", cell=-1.0, cutoff=0.0)
    assert [problem.key for problem in told.value.problems] == ["method", "cell", "cutoff"]


def test_a_cell_smaller_than_an_atom_is_refused() -> None:
    words = "cell = 0.5: is smaller than an atom, which is 1 wide"
    with pytest.raises(InputError, match=words):
        Settings(cell=0.5).resolved(1.0)
    assert Settings(cell=0.5, spacing=0.5).resolved(1.0).cell == 0.5
