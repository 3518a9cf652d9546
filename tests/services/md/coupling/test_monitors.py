"""The monitors of the atoms together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.coupling.monitors import COUNT, Monitors
from gimpmd_md.roles import PROJECTED, WATCHED
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.block import ALONE, FORCE
from tests.services.md.driving import advance_by, energies, having


def kinds(side: MdSide) -> list[str]:
    return [finding.kind for finding in side.findings()]


def test_atoms_at_rest_are_sound(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    for changes in ({}, FORCE, ALONE):
        side = start(make(**changes))
        advance_by(side, 30)
        assert kinds(side) == []


def test_the_band_of_short_waves_contains_the_watched_atoms(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    side = start(make(**FORCE))
    watched, seen = having(side, WATCHED), having(side, PROJECTED)
    assert (seen | ~watched).all()
    assert watched.sum() < seen.sum()


def test_atoms_faster_than_a_solid_body(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    side = start(make(**ALONE))
    side.atoms.v[:] = np.random.default_rng(1).normal(0.0, 3.0, side.atoms.v.shape)
    advance_by(side, 30)  # of 20 MD steps, to the second look
    assert "speed" in kinds(side)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("pair_coeff * * 1.1 1\n", "initial energy"),
        ("delete_atoms random count 3 yes gimpmd_free NULL 1\n", "atoms"),
    ],
)
def test_what_the_script_after_changes_is_found_at_the_start(
    start: Callable[[Case], MdSide],
    make: Callable[..., Case],
    folder: Path,
    text: str,
    kind: str,
) -> None:
    (folder / "after.in").write_text(text)
    side = start(make(**ALONE, md__after="after.in"))
    assert kind in kinds(side)


def test_a_stretched_start_is_explained(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    stretch = {"gradient": [[0.04, 0.0], [0.0, -0.04]]}
    assert kinds(start(make(**ALONE, initial__stretch=stretch))) == []


def test_they_go_on_from_their_state(
    start: Callable[[Case], MdSide], make: Callable[..., Case]
) -> None:
    case = make(**FORCE)
    side = start(case)
    monitors = Monitors(make_plan(case), side.atoms)
    state = monitors.state() | {COUNT: np.array(1.0)}
    monitors.restore(state)
    assert "atoms" in [finding.kind for finding in monitors.look(15, energies(side))]
