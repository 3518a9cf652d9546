"""The paper's section 3.3: strains of atoms in a pulled and a sheared plate (examples)."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples/atomic-strain"
GRID = ("linear 2", "linear 2.5", "quadratic 2", "quadratic 2.5")

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, float], dict[str, dict[str, float]]]:
    """Numbers by test and speed, then by method; needs scikit-fem."""
    sys.path.insert(0, str(EXAMPLE))
    try:
        import compare
    finally:
        sys.path.remove(str(EXAMPLE))
    return compare.compute()[2]


@pytest.mark.parametrize("test", ["tension", "shear"])
@pytest.mark.parametrize("speed", [0.1, 0.02])
def test_inner_atom(found: dict, test: str, speed: float) -> None:
    """Follows the finite elements, with less noise than the virial strain, and in time."""
    methods = found[test, speed]
    arrival = {"tension": 18.9 / 9.466, "shear": 18.9 / 5.465}[test]
    assert methods["finite elements"]["rise"] == pytest.approx(arrival, abs=0.1)
    for name in GRID:
        assert methods[name]["rms"] < 0.24
        assert methods[name]["high frequency"] < 0.8
        assert methods[name]["rise"] == pytest.approx(arrival, abs=0.4)


def papers(name: str) -> str:
    """The paper's weights with the same cell."""
    return f"paper {name.split()[1]}"


def test_surface_atom_in_tension(found: dict) -> None:
    """All components within 25 % where the plate is linear; the paper's normal strain is not."""
    methods = found["tension", 0.02]
    for name in GRID:
        for component in ("xx", "yy", "xy"):
            assert methods[name][f"surface {component}"] < 0.25
        assert methods[papers(name)]["surface yy"] > 0.4
        assert methods[papers(name)]["surface xy"] > 2.0 * methods[name]["surface xy"]


def test_surface_atom_in_shear(found: dict) -> None:
    """Spurious shear falls to less than half, with quadratic weights below 25 %."""
    methods = found["shear", 0.02]
    for name in GRID:
        assert methods[papers(name)]["surface xy"] > 2.5 * methods[name]["surface xy"]
        if name.startswith("quadratic"):
            assert methods[name]["surface xx"] < 0.25
            assert methods[name]["surface xy"] < 0.25


@pytest.mark.parametrize("test", ["tension", "shear"])
def test_weights_alone_at_the_surface(found: dict, test: str) -> None:
    """Fed with the displacements of the elements: each kind is better than the one before."""
    methods = found[test, "fed by elements"]
    for cell in ("2", "2.5"):
        for component in ("yy", "xy"):
            paper, linear, quadratic = (
                methods[f"{kind} {cell}"][f"surface {component}"]
                for kind in ("paper", "linear", "quadratic")
            )
            assert quadratic < linear < paper
