"""Which particles a figure shows."""

import numpy as np

from gimpmd_deploy.figures.shown import show
from tests.deploy.figures.three_d import make_run


def test_what_follows_the_other_side_is_not_shown(block):
    shown = show(block, 0.8, block.particles(0.8), "sigma_yy")
    zones = block.plan.coupled.zones
    assert zones.depth(shown.points.reference).max() < zones.energy_plane
    depth = zones.depth(shown.atoms.reference)
    assert depth.min() >= zones.outer > zones.depth(shown.followers.reference).max()
    assert len(shown.atoms) + len(shown.followers) == len(shown.all_atoms)
    np.testing.assert_array_equal(shown.atoms.fields["sigma_yy"], shown.atoms.stress[:, 1])


def test_a_side_without_the_field(block):
    shown = show(block, 0.8, block.particles(0.8), "temperature")
    assert "temperature" in shown.atoms.fields
    assert not shown.points.fields


def test_three_dimensions_show_a_slice_through_the_middle(tmp_path):
    run = make_run(tmp_path)
    shown = show(run, 0.0, run.particles(0.0), "sigma_yy")
    assert shown.atoms is None
    # z = 12 is the face between two layers of cubes: both are cut
    assert np.unique(shown.points.position[:, 2]).tolist() == [10.0, 14.0]
