"""What is said before a run: a scheme that is unstable, and level changes close to the atoms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.cautions import cautions, early_cautions
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.schemas.case.test_plan import FORCE

Make = Callable[..., Case]


def test_the_published_scheme_gets_a_caution(make: Make) -> None:
    assert cautions(make_plan(make(coupling__scheme="velocity"))) == []
    case = make(coupling__scheme="paper")
    (said,) = cautions(make_plan(case))
    assert "unstable without damping" in said
    assert early_cautions(case) == [said]
    assert cautions(make_plan(make(coupling__scheme="paper", only="md"))) == []
    assert early_cautions(make(coupling__scheme="paper", only="md")) == []


def nested(box: Any, **changes: Any) -> dict[str, Any]:
    """Planes at x = 70, y = 30 and y = 50 in one finer level of cells of 2."""
    levels = [{"boxes": [box]}]
    return FORCE | {"md__region": [[0, 80], [24, 56]], "grid__levels": levels} | changes


# waves of two cells of the coarser level and more leave room of 2 x 3.85 x 4 = 30.8
@pytest.mark.parametrize(
    ("box", "absorbed", "gap"),
    [
        ([[0, 96], [0, 80]], True, "26"),
        ([[0, 96], [8, 72]], True, "22"),
        ([[0, 120], [0, 80]], True, None),
        ([[0, 104], [0, 80]], True, None),
        ([[0, 96], [0, 80]], False, None),
    ],
)
def test_a_level_change_close_to_the_atoms(
    make: Make, box: Any, absorbed: bool, gap: str | None
) -> None:
    absorber = {"coupling__absorber": {}} if absorbed else {}
    case = make(**nested(box, **absorber))
    said = cautions(make_plan(case))
    assert said == early_cautions(case)
    assert len(said) == (gap is not None)
    for text in said:
        assert f"begins {gap} from the atoms; waves of length 7.7 to 15.4" in text
