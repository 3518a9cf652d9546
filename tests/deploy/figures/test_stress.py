"""The figure of the stress: which particles it shows, and what its title says."""

import numpy as np

from gimpmd_deploy.figures import stress
from tests.deploy.figures.three_d import make_run


def test_what_follows_the_other_side_is_not_shown(block):
    points, atoms, ghosts = stress._parts(block, 0.8)
    zones = block.plan.coupled.zones
    assert zones.depth(points.reference).max() < zones.energy_plane
    assert zones.depth(atoms.reference).min() >= zones.outer > zones.depth(ghosts.reference).max()
    assert len(atoms) + len(ghosts) == len(block.atoms())


def test_three_dimensions_show_a_slice_through_the_middle(tmp_path):
    run = make_run(tmp_path)
    points, atoms, _ = stress._parts(run, 0.0)
    assert atoms is None
    # z = 12 is the face between two layers of cubes: both are cut
    assert np.unique(points.position[:, 2]).tolist() == [10.0, 14.0]
    assert "slice at z = 12" in stress._title(run.plan, 0.0)


def test_a_dozen_pictures_over_time(block, tmp_path, monkeypatch):
    monkeypatch.setattr(type(block), "times", list(np.linspace(0.0, 0.8, 30)))
    monkeypatch.setattr(stress, "_draw_stress", lambda run, time, limit, path: path)
    assert len(stress.draw_stresses(block, tmp_path, every=False)) == 1 + stress.MANY
    assert len(stress.draw_stresses(block, tmp_path, every=True)) == 1 + 30


def test_the_scale_ignores_few_extreme_values(block):
    atoms = block.atoms()
    atoms.stress[:, 1] = 1.0
    atoms.stress[0, 1] = 1e6
    assert stress._limit(atoms, None) == 1.0
    assert stress._limit(None) == 1.0
