"""The user's script: what it must make."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_md.side import MdSide
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError

Start = Callable[[Case], MdSide]
Make = Callable[..., Case]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pair_style lj/cut", "pair_style lj/cat", r"block.in: .*lj/cat"),
        ("mass 1 ${mass}", "include none.in", r"none.in"),
        ("mass 1 ${mass}", "", r"[mM]ass"),
        ("mass 1 ${mass}", "mass 1 1\nfix 1 all nve", r"fix 1 \(nve\) integrates"),
        ("mass 1 ${mass}", "mass 1 1\nfix t all nvt temp 1 1 1", r"fix t \(nvt\) integrates"),
        ("mass 1 ${mass}", "mass 1 1\nfix t all gjf 1 1 1 7", r"fix t \(gjf\) integrates"),
        ("units ${style}", "units metal", r"units metal, but the case has units: lj"),
        ("dimension 2", "dimension 3", r"block.in: .*dimension"),
        ("create_atoms 1 region box", "", r"no atoms"),
        ("boundary s ${edge} p", "boundary p s p", r"periodic along x"),
        ("2.5*${scale}", "3.5*${scale}", r"cutoff 3.5 is wider than the outer zone 2.6"),
        ("region box block ${xlo}", "region box block 10", r"outside the MD region"),
    ],
)
def test_bad_scripts_are_refused_in_lammps_words(
    start: Start, make: Make, folder: Path, old: str, new: str, words: str
) -> None:
    text = (folder / "block.in").read_text()
    assert old in text
    (folder / "block.in").write_text(text.replace(old, new))
    with pytest.raises(BackendError, match=words):
        start(make())


def test_atoms_in_space_are_refused_in_a_plane_case(start: Start, make: Make, folder: Path) -> None:
    (folder / "block.in").write_text(
        "units lj\nboundary s s p\nregion box block ${xlo} ${xhi} ${ylo} ${yhi} -3 3\n"
        "create_box 1 box\ncreate_atoms 1 single 20 20 0\n"
    )
    with pytest.raises(BackendError, match=r"dimension 3, but domain.box of the case has 2 axes"):
        start(make())


def test_no_pair_style_is_refused(start: Start, make: Make, folder: Path) -> None:
    text = (folder / "block.in").read_text().split("pair_style")[0]
    (folder / "block.in").write_text(text)
    with pytest.raises(BackendError, match="sets no pair_style"):
        start(make())
