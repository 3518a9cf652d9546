"""Particles: a part of them, and as a table."""

import numpy as np
import pytest

from gimpmd_deploy.results.particles import Particles, voigt_names


def particles(dim: int) -> Particles:
    x = np.arange(3.0 * dim).reshape(3, dim)
    stress = np.arange(3.0 * len(voigt_names(dim))).reshape(3, -1)
    fields = {"level": np.array([0, 1, 2]), "strain": stress}
    return Particles(1.0, x, x + 1.0, x + 2.0, x + 3.0, stress, np.ones_like(x), fields)


def test_names_of_components():
    assert voigt_names(2) == ["xx", "yy", "xy"]
    assert voigt_names(3) == ["xx", "yy", "zz", "yz", "xz", "xy"]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_part(dim):
    part = particles(dim).where(np.array([True, False, True]))
    assert (len(part), part.dim) == (2, dim)
    assert part.fields["level"].tolist() == [0, 2]
    assert part.position[1, 0] == 2.0 * dim + 1.0


@pytest.mark.parametrize("dim", [2, 3])
def test_to_dataframe(dim):
    frame = particles(dim).to_dataframe()
    assert len(frame) == 3
    assert frame["velocity_y"].tolist() == [4.0, 4.0 + dim, 4.0 + 2 * dim]
    assert frame["level"].tolist() == [0, 1, 2]
    assert {"stress_xy", "strain_0", f"position_{'xyz'[dim - 1]}"} <= set(frame)
