"""The order of the coefficients of a strain energy."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest

from gimpmd_schemas.mechanics.hyperelastic import degree_of, exponents, quadratic, stiffness


def test_order_of_the_terms() -> None:
    assert exponents(2, 3).tolist() == [[2, 0], [1, 1], [0, 2], [3, 0], [2, 1], [1, 2], [0, 3]]
    assert exponents(3, 2).tolist() == [
        [2, 0, 0],
        [1, 1, 0],
        [1, 0, 1],
        [0, 2, 0],
        [0, 1, 1],
        [0, 0, 2],
    ]


@pytest.mark.parametrize("components", [1, 3, 6])
@pytest.mark.parametrize("degree", [2, 3, 5])
def test_every_term_is_there_once(components: int, degree: int) -> None:
    """All monomials up to the degree, less one constant and the linear ones."""
    powers = exponents(components, degree)
    assert len(powers) == comb(components + degree, degree) - 1 - components
    assert len({tuple(a) for a in powers.tolist()}) == len(powers)
    assert set(powers.sum(axis=1)) == set(range(2, degree + 1))


def test_degree_follows_from_the_number_of_terms() -> None:
    for components in (1, 3, 6):
        for degree in range(2, 7):
            count = len(exponents(components, degree))
            assert degree_of(components, count) == degree
            assert degree_of(6, 22) is None
    assert degree_of(3, 0) is None
    assert degree_of(3, 7) is None


@pytest.mark.parametrize("components", [3, 6])
def test_a_stiffness_is_found_again_from_its_quadratic_terms(components: int) -> None:
    """To the bit; coefficients of higher degree do not count."""
    A = np.random.default_rng(0).standard_normal((components, components))
    C = A + A.T
    np.testing.assert_array_equal(stiffness(components, quadratic(C)), C)
    np.testing.assert_array_equal(stiffness(components, [*quadratic(C), 1.0, 2.0]), C)


def test_quadratic_terms_are_the_energy_of_the_stiffness() -> None:
    A, E = np.random.default_rng(1).standard_normal((6, 6)), np.linspace(-1.0, 1.3, 6)
    C = A + A.T
    terms = np.prod(E ** exponents(6, 2), axis=1)
    assert terms @ quadratic(C) == pytest.approx(0.5 * E @ C @ E, rel=1e-14)
