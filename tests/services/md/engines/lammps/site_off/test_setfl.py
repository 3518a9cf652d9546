"""Tables of the embedded-atom method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.engines.lammps.library import own_potentials
from gimpmd_md.engines.lammps.site_off.setfl import (
    Tables,
    read_funcfls,
    read_setfl,
    with_off_sites,
    write_setfl,
)
from gimpmd_schemas.errors import BackendError


def same(one: Tables, other: Tables) -> bool:
    """Whether two tables agree to the last bit."""
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("names", "heads", "drho", "dr", "cutoff", "F", "rho", "z")
    )


@pytest.mark.parametrize("name", ["NiAlH_jea.eam.alloy", "AlFe_mm.eam.fs"])
def test_tables_are_written_as_they_are_read(name: str, tmp_path: Path) -> None:
    tables = read_setfl(own_potentials() / name, name.endswith("fs"))
    write_setfl(tables, tmp_path / name)
    assert same(read_setfl(tmp_path / name, name.endswith("fs")), tables)


def test_off_sites_have_no_embedding_and_half_of_each_pair(tmp_path: Path) -> None:
    tables = read_setfl(own_potentials() / "AlFe_mm.eam.fs", True)
    doubled = with_off_sites(tables)
    assert doubled.names == ("Al", "Fe", "Al0", "Fe0")
    assert not doubled.F[2:].any()
    np.testing.assert_array_equal(doubled.rho[2:, :2], tables.rho)
    np.testing.assert_array_equal(doubled.z[1, 2], 0.5 * tables.z[1, 0])
    assert not doubled.z[2:, 2:].any()


def test_elements_are_taken_by_name() -> None:
    tables = read_setfl(own_potentials() / "NiAlH_jea.eam.alloy", False)
    assert tables.names == ("Ni", "Al", "H")
    taken = tables.take(["H", "Ni"])
    np.testing.assert_array_equal(taken.z[0, 1], tables.z[2, 0])
    with pytest.raises(BackendError, match="no element Cu, only Ni, Al, H"):
        tables.take(["Cu"])


def test_a_file_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    rows = (own_potentials() / "Cu_u3.eam").read_text().splitlines()
    (tmp_path / "short.eam").write_text("\n".join(rows[:200]))
    with pytest.raises(BackendError, match=r"short.eam: .* ends \d+ numbers too early"):
        read_funcfls([tmp_path / "short.eam"], ["Cu"])
