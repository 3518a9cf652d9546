"""The crystal near the interface of the force scheme: what is refused, and what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import FORCE, A

Start = Callable[[Case], MdSide]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "pair_style lj/cut ${cutoff}\npair_coeff 1 1",
            "pair_style hybrid/scaled 1.0 lj/cut ${cutoff}\npair_coeff 1 1 lj/cut",
            r"block.in: .*sums over pairs.* use coupling.scheme: sites or velocity",
        ),
        ("origin 0.25 0.25 0", "origin 0.30 0.25 0", r"is not at a lattice site"),
        (
            "mass 1 ${mass}",
            "region hole block 17.2 17.8 20 21 EDGE EDGE units box\n"
            "delete_atoms region hole\nmass 1 1",
            r"no atom at \(17.\d*, 20.\d*\), a site of the lattice .*coupling.scheme: velocity",
        ),
        (
            "mass 1 ${mass}",
            "create_atoms 1 single 14.0 26.0 0 units box\nmass 1 1",
            r"atom at \(14, 26\), .* is not at a lattice site",
        ),
    ],
    ids=["potential", "shifted", "vacancy", "interstitial"],
)
def test_what_the_continuum_cannot_know_is_refused(
    start: Start, make: Callable[..., Case], folder: Path, old: str, new: str, words: str
) -> None:
    text = (folder / "block.in").read_text()
    assert old in text
    (folder / "block.in").write_text(text.replace(old, new))
    with pytest.raises(BackendError, match=words):
        start(make(**FORCE))


def test_a_vacancy_far_from_the_planes_is_allowed(
    start: Start, make: Callable[..., Case], folder: Path
) -> None:
    text = (folder / "block.in").read_text()
    hole = "region hole sphere 26 26 0 2.0 units box\ndelete_atoms region hole\n"
    (folder / "block.in").write_text(text.replace("mass 1", hole + "mass 1"))
    side = start(make(**FORCE))
    assert np.abs(side.zone_fields()["force"]).max() > 0.0


def test_planes_shallower_than_the_potential_are_refused(
    start: Start, make: Callable[..., Case]
) -> None:
    planes = {**FORCE["coupling__planes"], "left": 27 * A / 2}
    with pytest.raises(
        BackendError, match=r"coupling.planes.left: 15.0282 is 2.02822 inside md.region"
    ):
        start(make(**{**FORCE, "coupling__planes": planes}))
