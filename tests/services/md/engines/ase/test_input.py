"""The input for ASE: what is wrong with it is said in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gimpmd_md.engines.ase.input import calculator_maker, read_input
from gimpmd_schemas.errors import BackendError
from tests.services.md.engines.ase import inputs


def test_a_calculator_is_made_with_its_arguments(folder: Path) -> None:
    inputs.write(folder)
    made = calculator_maker("block.yaml", read_input("block.yaml", 2))()
    assert made.parameters["rc"] == 2.5


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"crystal": None}, "give either crystal or structure"),
        ({"structure": "a.xyz"}, "give either crystal or structure"),
        ({"crystals": {}}, "unknown field `crystals`"),
        ({"masses": {"X": 0}}, "masses.X = 0 must be positive"),
        ({"crystal": inputs.CRYSTAL | {"cell": [1.0]}}, "crystal.cell = .1.0. must be 2 positive"),
        ({"crystal": inputs.CRYSTAL | {"sites": [[0.0]]}}, "crystal.sites must be positions of 2"),
        ({"crystal": inputs.CRYSTAL | {"species": ["X"]}}, "species has 1 entries, but .*sites"),
        ({"crystal": inputs.CRYSTAL | {"origin": [1.0]}}, "crystal.origin = .1.0. must have 2"),
    ],
)
def test_a_wrong_input_is_refused(folder: Path, changes: dict[str, Any], words: str) -> None:
    inputs.write(folder, **changes)
    with pytest.raises(BackendError, match=f"block.yaml: .*{words}"):
        read_input("block.yaml", 2)


def test_a_missing_or_foreign_file_is_refused(folder: Path) -> None:
    with pytest.raises(BackendError, match=r"is not an input for md.backend: ase: .*No such file"):
        read_input("none.yaml", 2)
    with pytest.raises(BackendError, match=r"is not an input for md.backend: ase"):
        read_input("block.in", 2)  # a LAMMPS script


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"calculator": "ase.calculators.emt"}, "must be module:name"),
        ({"calculator": "no_such_module:Lj"}, "No module named 'no_such_module'; install"),
        ({"calculator": "ase.calculators.emt:Emt"}, "has no attribute 'Emt'"),
        ({"arguments": {"sigma": 1, "label": 5, "restart": 7}}, "LennardJones with the arguments"),
    ],
)
def test_a_calculator_that_cannot_be_made(
    folder: Path, changes: dict[str, Any], words: str
) -> None:
    inputs.write(folder, **changes)
    with pytest.raises(BackendError, match=f"block.yaml: .*{words}"):
        calculator_maker("block.yaml", read_input("block.yaml", 2))()
