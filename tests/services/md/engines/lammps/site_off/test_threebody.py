"""Entries of Stillinger-Weber and Tersoff potentials."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_md.engines.lammps.library import own_potentials
from gimpmd_md.engines.lammps.site_off.threebody import read_entries, with_off_sites, write_entries


@pytest.mark.parametrize(
    ("name", "style", "pair", "three", "count"),
    [("GaN.sw", "sw", 6, 3, 8), ("SiC.tersoff", "tersoff", 13, 9, 8)],
)
def test_entries_of_sites_that_are_off(
    name: str, style: str, pair: int, three: int, count: int, tmp_path: Path
) -> None:
    comment, entries = read_entries(own_potentials() / name, style)
    assert len(entries) == count
    one, other = dict.fromkeys(triple[0] for triple in entries)
    doubled = with_off_sites(entries, [one, other], style)
    assert len(doubled) == 4**3
    own = [float(number) for number in entries[one, other, other]]
    for first, second, of_pair, of_site in (
        (one, other, 1.0, 1.0),
        (one, other + "0", 0.5, 1.0),
        (one + "0", other, 0.5, 0.0),
        (one + "0", other + "0", 0.0, 0.0),
    ):
        found = [float(number) for number in doubled[first, second, second]]
        assert found[pair] == of_pair * own[pair]
        assert found[three] == of_site * own[three]
        kept = [k for k in range(len(own)) if k not in (pair, three)]
        assert [found[k] for k in kept] == [own[k] for k in kept]
    write_entries(comment, doubled, tmp_path / name)
    assert read_entries(tmp_path / name, style) == (comment, dict(doubled))
