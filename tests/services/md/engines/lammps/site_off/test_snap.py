"""Coefficients of SNAP potentials."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimpmd_md.engines.lammps.library import own_potentials
from gimpmd_md.engines.lammps.site_off.snap import check_parameters, read_elements, write_elements
from gimpmd_schemas.errors import BackendError


def test_elements_that_are_off_keep_radius_and_weight(tmp_path: Path) -> None:
    comment, elements = read_elements(own_potentials() / "InP_JCPA2020.snapcoeff")
    assert list(elements) == ["In", "P"]
    write_elements(comment, list(elements.values()), tmp_path / "off.snapcoeff")
    _, found = read_elements(tmp_path / "off.snapcoeff")
    assert list(found) == ["In", "P", "In0", "P0"]
    assert found["P"] == elements["P"]
    assert (found["P0"].radius, found["P0"].weight) == (elements["P"].radius, elements["P"].weight)
    assert not any(float(word) for word in found["P0"].coefficients)


def test_a_file_of_another_format_is_refused() -> None:
    with pytest.raises(BackendError, match=r"Si.sw: is no file of SNAP coefficients"):
        read_elements(own_potentials() / "Si.sw")


def test_neighbours_told_apart_by_element_are_refused() -> None:
    check_parameters(own_potentials() / "Cu_Zuo_JPCA2020.snapparam")
    with pytest.raises(BackendError, match="chemflag 1"):
        check_parameters(own_potentials() / "InP_JCPA2020.snapparam")
