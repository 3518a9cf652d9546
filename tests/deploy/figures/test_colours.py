"""Colour scales."""

import numpy as np
import pytest

from gimpmd_deploy.figures.colours import DIVERGING, SEQUENTIAL, given_scale, scale_of


def test_zero_is_the_middle_of_signed_fields():
    scale = scale_of([np.linspace(-1.0, 3.0, 401)], "signed")
    assert scale.low == -scale.high
    assert scale.high == pytest.approx(np.percentile(np.abs(np.linspace(-1, 3, 401)), 99.0))
    assert scale.cmap == DIVERGING


def test_few_extreme_values_are_ignored():
    values = np.ones(1000)
    values[:3] = 1e6
    assert scale_of([values], "signed").high == 1.0
    assert scale_of([values], "positive").high == 1.0


def test_one_scale_holds_both_sides():
    sides = [np.full(10, 2.0), np.full(10_000, 1.0)]
    assert scale_of(sides, "positive") == given_scale(0.0, 2.0, "positive")
    low = scale_of([np.array([-3.0, -3.0]), np.array([-2.0])], "any")
    assert (low.low, low.high, low.cmap) == (-3.0, -2.0, SEQUENTIAL)


def test_a_field_that_is_mostly_zero_shows_its_largest_value():
    values = np.zeros(1000)
    values[0] = 0.25
    assert scale_of([values], "positive").high == 0.25


@pytest.mark.parametrize("kind", ["signed", "positive", "any"])
def test_fields_without_extent(kind):
    for values in ([], [np.zeros(5)], [np.array([np.nan])]):
        scale = scale_of(values, kind)
        assert scale.low < scale.high
