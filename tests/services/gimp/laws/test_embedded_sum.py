"""The sum over the neighbours of embedded atoms, against its definition."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.laws import AnisotropicElastic, EmbeddedSum
from gimpmd_schemas.mechanics.elasticity import voigt_place
from gimpmd_schemas.mechanics.splines import interpolate
from tests.services.gimp.laws.sample_laws import (
    DENSITY,
    any_stiffness,
    embedded,
    energy,
    gradients,
    stress,
    stress_at_rest,
)


def by_definition(law: EmbeddedSum, F: np.ndarray) -> float:
    """Energy of an atom over its volume."""
    r = np.linalg.norm(law.bonds @ F.T, axis=1)
    r = r[r < law.cutoff]
    around = 2.0 * interpolate(*law.cloud, r).sum()
    pairs = (interpolate(*law.pair, r) / r).sum()
    return float(interpolate(*law.embedding, around) + pairs) / law.volume


def test_energy_is_the_sum_less_that_of_the_stress_at_rest() -> None:
    """With a thermal stress, what the stress at rest does is part of it."""
    law, F = embedded(thermal=np.zeros(6)), gradients(3, 20, size=0.1)
    expected = [by_definition(law, f) - by_definition(law, np.eye(3)) for f in F]
    np.testing.assert_allclose(energy(law, F), expected, atol=1e-13)


def test_a_thermal_stress_is_the_stress_at_rest_of_the_atoms_and_more() -> None:
    thermal, rest = stress_at_rest(3), np.eye(3)[None]
    cold, warm = embedded(thermal=np.zeros(6)), embedded(thermal)
    assert np.abs(stress(cold, rest)).max() > 0.1
    np.testing.assert_allclose(
        (stress(warm, rest) - stress(cold, rest))[0], thermal[voigt_place(3)], rtol=1e-13
    )


def test_neighbours_beyond_the_cutoff_do_not_count() -> None:
    """Stretched by 2.5 the shortest bond, of length 1.02, is longer than the cutoff."""
    law = embedded(thermal=np.zeros(6))
    F = 2.5 * np.eye(3)[None]
    assert (stress(law, F) == 0.0).all()


def test_fastest_wave_is_that_of_the_stiffness() -> None:
    expected = AnisotropicElastic(DENSITY, any_stiffness(3)).wave_speed()
    assert embedded().wave_speed() == expected
