"""Random numbers of sites and steps: known answers, moments, no correlation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gimpmd_md.coupling.noise import normals, philox

KNOWN = [
    ("00000000 00000000 00000000 00000000 00000000 00000000",
     "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff ffffffff ffffffff",
     "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344 a4093822 299f31d0",
     "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip
"""Counter and key, and what comes of them: ``kat_vectors`` of Random123, philox4x32 10."""


@pytest.mark.parametrize(("given", "expected"), KNOWN)
def test_known_answers(given: str, expected: str) -> None:
    words = [np.uint64(int(word, 16)) for word in given.split()]
    assert [f"{int(word):08x}" for word in philox(*words)] == expected.split()


def grid_of_sites(n: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2)


def test_numbers_are_standard_normal() -> None:
    drawn = normals(1, 7, grid_of_sites(300))
    for column in drawn.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    n = len(drawn)
    assert abs((drawn[:, 0] * drawn[:, 1]).mean()) < 4.0 / np.sqrt(n)


def test_neighbours_steps_and_seeds_are_independent() -> None:
    sites = grid_of_sites(200)
    here = normals(3, 11, sites)
    right, above = sites + np.array([1, 0]), sites + np.array([0, 1])
    others = [normals(3, 11, right), normals(3, 11, above)]
    others += [normals(seed, step, sites) for seed, step in ((3, 12), (4, 11), (3, 11 + 2**32))]
    for other in others:
        assert abs((here * other).mean()) < 4.0 / np.sqrt(here.size)
    mirrored, off = normals(3, 11, sites[:, ::-1]), sites[:, 0] != sites[:, 1]
    assert abs((here * mirrored)[off].mean()) < 4.0 / np.sqrt(here.size)


def test_numbers_of_a_block() -> None:
    """Three components: standard normal, uncorrelated with each other, neighbours and steps."""
    sites = np.stack(np.meshgrid(*[np.arange(40)] * 3), axis=-1).reshape(-1, 3)
    drawn, limit = normals(1, 7, sites), 4.0 / np.sqrt(len(sites))
    for column in drawn.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < limit
    others = [normals(1, 7, sites + np.eye(3, dtype=np.int64)[axis]) for axis in range(3)]
    others += [normals(seed, step, sites) for seed, step in ((1, 8), (2, 7))]
    for other in others:
        assert abs((drawn * other).mean()) < limit
        assert abs((drawn * np.roll(other, 1, axis=1)).mean()) < limit


def test_a_site_has_its_numbers_in_any_company() -> None:
    sites = grid_of_sites(20) - 10  # negative ones too
    order = np.random.default_rng(0).permutation(len(sites))[:100]
    np.testing.assert_array_equal(normals(1, 2, sites)[order], normals(1, 2, sites[order]))
