"""Places of the two planes of a face."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.crystal.plane_pairs import SHARES, THICKEST, pairs, thickness


@pytest.mark.parametrize(
    ("layer", "cutoff", "layers"),
    [(0.5566, 2.5, 4), (0.964, 2.5, 2), (1.80746, 5.50679, 3), (1.0, 2.0, 2), (3.0, 2.0, 1)],
)
def test_free_atoms_are_no_neighbours_of_outer_ghosts(
    layer: float, cutoff: float, layers: int
) -> None:
    """Distance of the two is one layer more than that of the planes."""
    assert thickness(layer, cutoff) == layers
    assert (layers + 1) * layer > cutoff


@pytest.mark.parametrize("outward", [-1.0, 1.0])
def test_planes_follow_the_rule(outward: float) -> None:
    layer, offset, cutoff, h, origin = 0.5566, 0.1, 2.5, 3.0, -0.7
    for wanted in np.linspace(-4.0, 4.0, 33):
        found = pairs(wanted, outward, layer, offset, cutoff, h, origin)[0]
        assert abs(found.first - wanted) <= 0.5 * h
        layers = (found.second - found.first) * outward / layer
        assert layers == pytest.approx(round(layers))
        assert round(layers) == 4 or (round(layers) == 5 and 5 * layer <= THICKEST * h)
        for plane in (found.first, found.second):
            assert (plane - offset) / layer == pytest.approx(round((plane - offset) / layer))
        share = 1.0 - (found.first - origin) * outward / h % 1.0
        assert SHARES[0] - 1e-9 < share < SHARES[1] + 1e-9
        clear = (found.second - origin) / h % 1.0
        assert 0.25 < clear < 0.75  # layers are much closer than node lines


def test_cells_of_one_layer_have_planes_at_some_places_only() -> None:
    """All planes cut their cells at the same share."""
    for offset in np.linspace(0.0, 0.95, 20):
        found = pairs(0.0, 1.0, 1.0, offset, 2.5, 1.0, origin=0.0)
        assert bool(found) == (SHARES[0] - 1e-9 < 1.0 - offset < SHARES[1] + 1e-9)
